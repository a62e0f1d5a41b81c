"""JSON as plain data.

Python's parser takes any size and nearly a thousand levels, and leaves it to whoever walks over the data to run out of
stack.  Both are counted before: brackets and commas are an upper bound of what the data can hold.
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from echelon.errors import InputError, one_line
from echelon.inputs.content import DATA_NODES, DEPTH, Limit, decoded

# a string that does not end goes to the end of the text, so that no part of it is looked at twice
_TOKEN = re.compile(r'"(?:[^"\\]++|\\.)*+(?:"|\\?\Z)|[\[\]{}]', re.DOTALL)


def parse_json(content: str | bytes, source: str, nodes: Limit = DATA_NODES, *, as_text: bool = False) -> Any:
    """Parse a JSON document.

    >>> parse_json('{"mass": 0.30}', "arm.json", as_text=True)
    {'mass': '0.30'}
    """
    text = decoded(content, source)
    _check_size(text, source, nodes)

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            twice = Counter(key for key, _ in pairs).most_common(1)[0][0]
            raise InputError(f"the key '{one_line(twice)}' occurs twice in one object", source=source)
        return found

    written: dict[str, Any] = dict.fromkeys(("parse_float", "parse_int", "parse_constant"), str) if as_text else {}
    try:
        return json.loads(text, object_pairs_hook=unique, **written)
    except json.JSONDecodeError as error:
        raise InputError(f"not well-formed JSON: {error.msg} (line {error.lineno})", source=source) from None
    except ValueError as error:  # Python's limit for the digits of integers
        raise InputError(f"not readable as JSON: {one_line(str(error))}", source=source) from None


def _check_size(text: str, source: str, nodes: Limit) -> None:
    opened = text.count("[") + text.count("{")
    nodes.check(opened + text.count(","), source)
    if opened <= DEPTH.most:
        return
    depth = 0
    for token in _TOKEN.finditer(text):
        character = text[token.start()]
        depth += (character in "[{") - (character in "]}")
        DEPTH.check(depth, source)


def published_schema(name: str, schema: dict[str, Any]) -> dict[str, Any]:
    """A schema that says its dialect, and a name that is no address, with the version of the format."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": f"urn:echelon:schema:{name}:1", **schema}


def plain_data(value: Any, missing: Any = None) -> Any:
    """Data in terms of JSON: dataclasses as objects, arrays as lists, null or a word for what is no finite number."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain_data(asdict(value), missing)
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.ndarray | np.generic):
        return plain_data(value.tolist(), missing)
    if isinstance(value, Mapping):
        return {str(key): plain_data(entry, missing) for key, entry in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain_data(entry, missing) for entry in value]
    return missing if isinstance(value, float) and not math.isfinite(value) else value
