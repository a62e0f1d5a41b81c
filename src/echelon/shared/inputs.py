"""Documents, read as a whole and within limits: their content, and YAML, JSON and XML as plain data.

Pipes are read as well as files (``echelon derive <(xacro arm.xacro)``), so the size that the system states is not
relied on: a link to a device without end has size 0.  What streams, such as the samples of a log, may be as long as the
disk is large.  What multiplies, such as nested brackets, names, columns, or archives of zeros, is bounded, because a
small file could otherwise keep the machine busy or fill its memory.  No file of a robot known to us comes near any of
these numbers.

PyYAML is used only as far as its events.  Its own conversion would turn ``0.0825`` into a float, ``010`` into eight and
``no`` into False, would accept duplicate keys, and calls itself for each level.  Aliases and merge keys are refused,
because a few of them can make a small file expand without bounds.  Python's JSON parser takes any size and nearly a
thousand levels, and leaves it to whoever walks over the data to run out of stack.  Both are counted before: brackets
and commas are an upper bound of what the data can hold.  Entities and external references of XML are refused before
anything else looks at the text.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, is_dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from echelon.shared.errors import InputError, shortened

if TYPE_CHECKING:
    import yaml


READ: set[str] = set()
"""Paths of the files that the running command reads, which no output may replace."""


def read_content(path: str | os.PathLike[str]) -> bytes:
    """All bytes of a document."""
    source = os.fspath(path)
    READ.add(source)
    try:
        with Path(path).open("rb") as stream:
            content = stream.read(DOCUMENT.most + 1)
    except FileNotFoundError:
        raise InputError("cannot be read: no such file", source=source) from None
    except (OSError, ValueError) as error:  # ValueError: a name that no system allows
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"cannot be read: {reason}", source=shortened(source, _LONGEST_NAME)
        ) from None
    DOCUMENT.check(len(content), source)
    return content


def decoded(content: str | bytes, source: str) -> str:
    """The text of a document, without a byte order mark."""
    DOCUMENT.check(len(content), source)
    if isinstance(content, str):
        return content.removeprefix("\ufeff")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"not UTF-8 text: {error.reason} at byte {error.start}", source=source
        ) from None


def read_document(path: str | os.PathLike[str]) -> str:
    """The text of a document in UTF-8."""
    return decoded(read_content(path), os.fspath(path))


_LONGEST_NAME = 255  # bytes of a file's name, on all usual systems; what is longer was meant as text
_MIB = 1 << 20  # bytes


@dataclass(frozen=True)
class Limit:
    """A bound of something that is counted in an input."""

    most: int  # the largest number that is accepted
    unit: str  # what is counted, in the plural
    advice: str = ""  # what to do about a file that has more

    def check(
        self, found: int, source: str | None = None, element: str | None = None
    ) -> None:
        """Refuse an input that has more."""
        if found > self.most:
            problem = f"has more than {self}" + (
                f"; {self.advice}" if self.advice else ""
            )
            raise InputError(problem, source=source, element=element)

    def __str__(self) -> str:
        if self.unit == "bytes" and self.most % _MIB == 0:
            return f"{self.most // _MIB} MiB"
        return f"{self.most:,} {self.unit}"


DOCUMENT = Limit(64 * _MIB, "bytes", "that is not a description, result or model")
DEPTH = Limit(
    64, "levels of brackets inside one another", "nested too deeply to be a document"
)
DESCRIPTION_NODES = Limit(
    250_000, "numbers, texts, lists and mappings", "that is not a description"
)
DATA_NODES = Limit(
    4_000_000,
    "numbers, texts, lists and mappings",
    "keep samples in a table (CSV, Parquet)",
)
SLOW_NODES = Limit(
    200_000,
    "numbers, texts, lists and mappings",
    "install PyYAML with libyaml, or write JSON",
)
XML_NODES = Limit(1_000_000, "elements and attributes", "that is not a robot")
XML_DEPTH = Limit(
    512, "elements inside one another", "the nesting is too deep for a robot"
)
INCLUDES = Limit(256, "included files", "put them together")
LINE = Limit(_MIB, "bytes in a line", "no log has lines as long")
COLUMNS = Limit(16_384, "columns", "write the quantities of the robot alone")
ENTRIES = Limit(256, "entries", "keep signals in columns of their own")
ARRAY_COLUMNS = Limit(4096, "columns of an array", "transpose it")
UNPACKED = Limit(64 * _MIB, "bytes")
EXPANSION = Limit(50, "times the size of the file")

LIMITS: Mapping[Limit, str] = {
    DOCUMENT: "size of every document: YAML, JSON, URDF, MJCF, set-ups, result files, claims, values, "
    "trajectories as JSON or YAML, metadata of bags",
    DEPTH: "nesting of JSON and YAML",
    DESCRIPTION_NODES: "content of descriptions, set-ups and linear models",
    DATA_NODES: "content of result files, claims, values and trajectories as JSON or YAML, and of every JSON message",
    SLOW_NODES: "content of YAML where PyYAML was built without libyaml",
    XML_NODES: "content of URDF and MJCF",
    XML_DEPTH: "nesting of URDF and MJCF",
    INCLUDES: "files that an MJCF file includes or attaches",
    LINE: "lines of CSV and other text logs",
    COLUMNS: "columns of a log of any kind, and arrays of an NPZ or MAT file",
    ENTRIES: "lists of messages and Parquet files, cells and arrays of structs of MATLAB, which are left out if longer",
    ARRAY_COLUMNS: "single arrays of NPZ, NPY and MAT files, which are left out if they have more",
    UNPACKED: "numbers of a packed log (gzip, NPZ, MAT, HDF5, Parquet, MCAP, bags), and besides",
    EXPANSION: "the same; a file that holds more for its size is packed zeros",
}
"""All limits, with what each of them bounds."""


def most_unpacked(packed: int) -> int:
    """Bytes that a file may hold after unpacking."""
    return UNPACKED.most + EXPANSION.most * packed


def check_unpacked(unpacked: int, packed: int, source: str | None = None) -> None:
    """Refuse an archive that grows out of proportion."""
    if unpacked > most_unpacked(packed):
        problem = f"unpacks to more than {UNPACKED} and {EXPANSION}; if that is right, save it without compression"
        raise InputError(problem, source=source)


def limits_table() -> str:
    """All limits as a Markdown table."""
    rows = [f"| {limit} | {bounds} |" for limit, bounds in LIMITS.items()]
    return "\n".join(["| at most | of |", "|---|---|", *rows]) + "\n"


# -- YAML --------------------------------------------------------------------------------------------------------------

_NULLS = frozenset({"", "~", "null", "Null", "NULL"})
_TAG = "tag:yaml.org,2002:"
_PLAIN = frozenset({None, "!", *(_TAG + kind for kind in ("str", "seq", "map"))})


@dataclass
class YamlDocument:
    """One document of a text."""

    data: Any = None  # mappings, lists, texts and None
    lines: dict[str, int] = field(
        default_factory=dict
    )  # line, counted from 1, of every element by its path


def step_into(path: str, key: str | int) -> str:
    """The path of an element of a list or mapping.

    >>> step_into(step_into("bodies", 3), "mass")
    'bodies[3].mass'
    """
    if isinstance(key, int):
        return f"{path}[{key}]"
    return f"{path}.{key}" if path else key


def dump_flow(data: Any) -> str:
    """Data in one line; a mapping of one key without the braces around it."""
    import yaml

    text = str(
        yaml.safe_dump(
            data,
            default_flow_style=True,
            sort_keys=False,
            allow_unicode=True,
            width=float("inf"),
        )
    )
    if isinstance(data, dict) and len(data) == 1:
        return text.strip()[1:-1]
    return text.strip()


def parse_yaml(
    content: str | bytes, source: str, nodes: Limit = DATA_NODES, *, lines: bool = False
) -> list[YamlDocument]:
    """Parse the documents of a YAML text; numbers stay text.

    >>> [document.data for document in parse_yaml("mass: 0.30", "arm.yaml")]
    [{'mass': '0.30'}]
    """
    import yaml

    text = decoded(content, source)
    if not yaml.__with_libyaml__ and nodes.most > SLOW_NODES.most:
        nodes = SLOW_NODES
    reader = _YamlReader(source, nodes, lines)
    try:
        for event in yaml.parse(
            text, yaml.CBaseLoader if yaml.__with_libyaml__ else yaml.BaseLoader
        ):
            reader.take(event)
    except yaml.MarkedYAMLError as error:
        raise InputError(_syntax_problem(error, text), source=source) from None
    except (yaml.YAMLError, ValueError) as error:
        problem = (str(error).splitlines() or [""])[0]
        raise InputError(f"not readable as YAML: {problem}", source=source) from None
    return reader.documents


def _syntax_problem(error: yaml.MarkedYAMLError, text: str) -> str:
    mark = error.problem_mark or error.context_mark
    line = (
        min(mark.line + 1, text.count("\n") + (not text.endswith("\n"))) if mark else 0
    )  # not behind the end
    where = f" (line {line}, column {mark.column + 1})" if mark else ""
    problem = error.problem or error.context or "syntax error"
    if "cannot start any token" in problem and "\t" in text:
        problem = "tabs cannot indent; use spaces"
    if (
        "nesting depth" in problem
    ):  # what the parser looks at ahead of its events is bounded, too
        problem = DEPTH.advice
    return f"not well-formed YAML: {problem}{where}"


@dataclass
class _Open:
    """An unfinished list or mapping: its data, its path, and the key of the next value."""

    data: Any
    path: str
    key: str | None = None


class _YamlReader:
    """Makes data of events, with a stack of its own."""

    def __init__(self, source: str, nodes: Limit, lines: bool) -> None:
        import yaml

        self.documents: list[YamlDocument] = []
        self._source, self._nodes, self._notes = source, nodes, lines
        self._open: list[_Open] = []
        self._count = 0
        self._take: dict[type, Callable[[Any], object]] = {
            yaml.DocumentStartEvent: lambda _: self.documents.append(YamlDocument()),
            yaml.ScalarEvent: self._scalar,
            yaml.SequenceStartEvent: lambda event: self._begin(event, []),
            yaml.MappingStartEvent: lambda event: self._begin(event, {}),
            yaml.SequenceEndEvent: lambda _: self._open.pop(),
            yaml.MappingEndEvent: lambda _: self._open.pop(),
            yaml.AliasEvent: self._alias,
        }

    def take(self, event: yaml.Event) -> None:
        act = self._take.get(type(event))
        if act is not None:
            act(event)

    def _alias(self, event: Any) -> None:
        raise self._error(
            self._place(),
            event,
            "aliases (*name) are not accepted; write the value out",
        )

    def _scalar(self, event: Any) -> None:
        self._check(event)
        within = self._open[-1] if self._open else None
        if within is not None and isinstance(within.data, dict) and within.key is None:
            self._key(within, event)
        else:
            self._put(
                event,
                None if event.value in _NULLS and not event.style else event.value,
            )

    def _key(self, within: _Open, event: Any) -> None:
        key: str = event.value
        inside = step_into(within.path, key) if self._notes else key
        if key in within.data:
            first = self.documents[-1].lines.get(inside)
            where = f", first in line {first}" if first else ""
            raise self._error(inside, event, f"the key '{key}' occurs twice{where}")
        if self._notes:
            self.documents[-1].lines[inside] = _line(event)
        within.key = key

    def _begin(self, event: Any, data: list[Any] | dict[str, Any]) -> None:
        self._check(event)
        if (
            self._open
            and isinstance(self._open[-1].data, dict)
            and self._open[-1].key is None
        ):
            raise self._error(self._open[-1].path, event, "keys must be plain words")
        path = self._place()
        self._put(event, data)
        self._open.append(_Open(data, path))
        DEPTH.check(len(self._open), self._source, f"line {_line(event)}")

    def _put(self, event: Any, value: Any) -> None:
        """A value goes where the next one belongs: to the innermost list or mapping."""
        if self._notes:
            self.documents[-1].lines.setdefault(self._place(), _line(event))
        if not self._open:
            self.documents[-1].data = value
            return
        within = self._open[-1]
        if within.key is None:
            within.data.append(value)
        else:
            within.data[within.key] = value
            within.key = None

    def _place(self) -> str:
        """Path of the value that comes next."""
        if not self._open:
            return ""
        within = self._open[-1]
        key = within.key if isinstance(within.data, dict) else len(within.data)
        return within.path if key is None else step_into(within.path, key)

    def _check(self, event: Any) -> None:
        self._count += 1
        self._nodes.check(self._count, self._source)
        if event.tag not in _PLAIN:
            shown = event.tag.removeprefix(_TAG)
            raise self._error(
                self._place(), event, f"tags such as !!{shown} are not accepted"
            )

    def _error(self, path: str, event: Any, problem: str) -> InputError:
        return InputError(
            f"{problem} (line {_line(event)})",
            source=self._source,
            element=path or None,
        )


def _line(event: Any) -> int:
    return int(event.start_mark.line) + 1


# -- JSON --------------------------------------------------------------------------------------------------------------

# a string that does not end goes to the end of the text, so that no part of it is looked at twice
_TOKEN = re.compile(r'"(?:[^"\\]++|\\.)*+(?:"|\\?\Z)|[\[\]{}]', re.DOTALL)


def parse_json(
    content: str | bytes,
    source: str,
    nodes: Limit = DATA_NODES,
    *,
    as_text: bool = False,
) -> Any:
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
            raise InputError(
                f"the key '{twice}' occurs twice in one object", source=source
            )
        return found

    written: dict[str, Any] = (
        dict.fromkeys(("parse_float", "parse_int", "parse_constant"), str)
        if as_text
        else {}
    )
    try:
        return json.loads(text, object_pairs_hook=unique, **written)
    except json.JSONDecodeError as error:
        raise InputError(
            f"not well-formed JSON: {error.msg} (line {error.lineno})", source=source
        ) from None
    except ValueError as error:  # Python's limit for the digits of integers
        raise InputError(f"not readable as JSON: {error}", source=source) from None


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
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:echelon:schema:{name}:1",
        **schema,
    }


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


# -- XML ---------------------------------------------------------------------------------------------------------------


# an unclosed one goes to the end of the text, so that no part of it is looked at twice
_COMMENT = re.compile(
    rb"<!\[CDATA\[.*?(?:\]\]>|\Z)|<\?.*?(?:\?>|\Z)|<!--.*?(?:-->|\Z)", re.DOTALL
)


def parse_xml(text: str | bytes, source: str) -> Any:
    """Root element of an XML document, with document types refused, and with them entities and external references.

    Names keep their prefixes, declared or not, such as ``drake:mimic``; comments may hold ``--``.
    """
    from xml.etree.ElementTree import TreeBuilder
    from xml.parsers import expat

    _check_xml_size(text, source)

    def refuse(*_: object) -> None:
        raise InputError(
            "document type declarations and entities are not accepted", source=source
        )

    # a text is decoded already, whatever encoding it declares
    builder = TreeBuilder()
    parser = expat.ParserCreate("utf-8" if isinstance(text, str) else None)
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler = builder.data
    try:
        content = text.encode() if isinstance(text, str) else text
        parser.Parse(_COMMENT.sub(_with_plain_comment, content), True)
    except expat.ExpatError as error:
        raise InputError(f"not well-formed XML: {error}", source=source) from None
    except (ValueError, LookupError) as error:
        raise InputError(f"cannot be decoded: {error}", source=source) from None
    root = builder.close()
    level, depth = [root], 0
    while level:
        depth += 1
        XML_DEPTH.check(depth, source)
        level = [child for element in level for child in element]
    return root


def _with_plain_comment(found: re.Match[bytes]) -> bytes:
    """A comment without the hyphens in it, of the same length; anything else as it is."""
    whole, start, end = found[0], len(b"<!--"), -len(b"-->")
    if not whole.startswith(b"<!--"):
        return whole
    return whole[:start] + whole[start:end].replace(b"-", b" ") + whole[end:]


def _check_xml_size(text: str | bytes, source: str) -> None:
    """Each element and each attribute has one of these characters, in every encoding."""
    DOCUMENT.check(len(text), source)
    found = (
        text.count("<") + text.count("=")
        if isinstance(text, str)
        else text.count(b"<") + text.count(b"=")
    )
    XML_NODES.check(found, source)
