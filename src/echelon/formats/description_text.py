"""From the text of a description to plain data, scalar by scalar as written, with the line of every element."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from echelon.errors import InputError
from echelon.inputs.content import decoded
from echelon.inputs.json_text import parse_json
from echelon.inputs.limits import DESCRIPTION_NODES
from echelon.inputs.yaml_text import parse_yaml

_LONGEST_MESSAGE = 600


@dataclass(frozen=True)
class Document:
    """A description as plain data: mappings, lists, texts, None (and, from JSON, truth values)."""

    data: Any
    source: str  # name of the file, for messages
    # line, counted from 1, of every element by its path; empty for JSON
    lines: Mapping[str, int] = field(default_factory=dict)
    # what the file calls elements, by the beginnings of their paths, where it is of another layout
    names: Mapping[str, str] = field(default_factory=dict)

    def error(self, path: str, problem: str) -> InputError:
        """An error about the element at a path such as ``modified_dh[3].alpha``."""
        begun = max((name for name in self.names if path.startswith(name)), key=len, default="")
        path = known = self.names.get(begun, "") + path.removeprefix(begun)
        while known and known not in self.lines:
            known = known[: max(known.rfind("."), known.rfind("["), 0)]
        line = f" (line {self.lines[known]})" if known else ""
        problem, path = " ".join(problem.split()), " ".join(path.split())
        if len(problem) > _LONGEST_MESSAGE:
            problem = f"{problem[:_LONGEST_MESSAGE]}…"
        return InputError(f"{problem}{line}", source=self.source, element=path or None)


def read_text(text: str | bytes, source: str) -> Document:
    """Parse YAML or JSON without interpreting scalars."""
    text = decoded(text, source)
    is_json = source.lower().endswith(".json")
    # YAML may begin with a brace as well, so JSON that fails is tried as YAML unless the file's name says JSON
    if is_json or text.lstrip().startswith("{"):
        try:
            return Document(parse_json(text, source, DESCRIPTION_NODES, as_text=True), source)
        except InputError:
            if is_json:
                raise
    found = parse_yaml(text, source, DESCRIPTION_NODES, lines=True)
    if len(found) > 1:
        line = found[1].lines.get("", 1)
        problem = f"one document describes one robot, but a second document begins (line {line})"
        raise InputError(f"not well-formed YAML: {problem}", source=source)
    if not found:
        raise InputError("the document is empty; a description begins with 'echelon: 1'", source=source)
    return Document(found[0].data, source, found[0].lines)
