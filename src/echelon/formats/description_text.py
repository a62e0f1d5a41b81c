"""From the text of a description to plain data, scalar by scalar as written.

PyYAML is used only as far as its node tree: its own conversion would turn ``0.0825`` into a float, ``010`` into eight
and ``no`` into False, and would accept duplicate keys.  Aliases are refused, because a few of them can make a small
file expand without bounds.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from echelon.errors import InputError

if TYPE_CHECKING:
    import yaml

_LARGEST = 16 * 1024 * 1024
_LONGEST_MESSAGE = 600
_NULLS = frozenset({"", "~", "null", "Null", "NULL"})
_PLAIN = frozenset({"str", "seq", "map"})


@dataclass(frozen=True)
class Document:
    """A description as plain data: mappings, lists, texts, None (and, from JSON, truth values).

    Attributes
    ----------
    data : object
    source : str
        Name of the file, for messages.
    lines : mapping of str to int
        Line, counted from 1, of every element by its path; empty for JSON.
    """

    data: Any
    source: str
    lines: Mapping[str, int] = field(default_factory=dict)

    def error(self, path: str, problem: str) -> InputError:
        """An error about the element at a path such as ``modified_dh[3].alpha``."""
        known = path
        while known and known not in self.lines:
            known = known[: max(known.rfind("."), known.rfind("["), 0)]
        line = f" (line {self.lines[known]})" if known else ""
        problem, path = " ".join(problem.split()), " ".join(path.split())
        if len(problem) > _LONGEST_MESSAGE:
            problem = f"{problem[:_LONGEST_MESSAGE]}…"
        return InputError(f"{problem}{line}", source=self.source, element=path or None)


def step_into(path: str, key: str | int) -> str:
    """The path of an element of a list or mapping."""
    if isinstance(key, int):
        return f"{path}[{key}]"
    return f"{path}.{key}" if path else key


def read_text(text: str | bytes, source: str) -> Document:
    """Parse YAML or JSON without interpreting scalars.

    Parameters
    ----------
    text : str or bytes
        UTF-8 if bytes.
    source : str
        File name for messages; a name that ends in ``.json`` must hold JSON.

    Returns
    -------
    Document

    Raises
    ------
    InputError
        If the text is not a well-formed document with unique keys and without aliases.
    """
    if isinstance(text, bytes):
        try:
            text = text.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise InputError(f"not UTF-8 text: {error.reason} at byte {error.start}", source=source) from None
    if len(text) > _LARGEST:
        raise InputError(f"larger than {_LARGEST >> 20} million characters; not a description", source=source)
    try:
        # YAML may begin with a brace as well, so JSON that fails is tried as YAML unless the file's name says JSON
        if source.lower().endswith(".json"):
            return _read_json(text, source)
        if text.lstrip().startswith("{"):
            try:
                return _read_json(text, source)
            except json.JSONDecodeError:
                pass
        return _read_yaml(text, source)
    except json.JSONDecodeError as error:
        raise InputError(f"not well-formed JSON: {error.msg} (line {error.lineno})", source=source) from None
    except RecursionError:
        raise InputError("nested too deeply to be a description", source=source) from None


def _read_json(text: str, source: str) -> Document:
    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            keys = [key for key, _ in pairs]
            twice = next(key for key in keys if keys.count(key) > 1)
            raise InputError(f"the key '{twice}' occurs twice in one object", source=source)
        return found

    # numbers and even NaN stay text; what they may be is decided where they are used
    data = json.loads(text, object_pairs_hook=unique, parse_float=str, parse_int=str, parse_constant=str)
    return Document(data, source)


def _read_yaml(text: str, source: str) -> Document:
    import yaml

    try:
        root = yaml.compose(text, Loader=yaml.BaseLoader)
    except yaml.MarkedYAMLError as error:
        raise InputError(_syntax_problem(error), source=source) from None
    except yaml.YAMLError as error:
        problem = str(error).splitlines()[0]
        raise InputError(f"not readable as YAML: {problem}", source=source) from None
    if root is None:
        raise InputError("the document is empty; a description begins with 'echelon: 1'", source=source)
    reader = _YamlReader(source)
    return Document(reader.read(root, ""), source, reader.lines)


def _syntax_problem(error: yaml.MarkedYAMLError) -> str:
    mark = error.problem_mark or error.context_mark
    where = f" (line {mark.line + 1}, column {mark.column + 1})" if mark else ""
    problem = error.problem or error.context or "syntax error"
    if problem == "but found another document":
        problem = "one document describes one robot, but a second document begins"
    elif "cannot start any token" in problem and "\\t" in problem:
        problem = "tabs cannot indent; use spaces"
    return f"not well-formed YAML: {problem}{where}"


class _YamlReader:
    """One walk over a tree of YAML nodes."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.lines: dict[str, int] = {}
        self._seen: set[int] = set()

    def read(self, node: yaml.Node, path: str) -> Any:
        """The data of a node, with the lines of all its elements noted."""
        self.lines.setdefault(path, self._line(node))
        if id(node) in self._seen:
            raise self._error(path, node, "aliases (*name) are not accepted; write the value out")
        self._seen.add(id(node))
        kind = node.tag.removeprefix("tag:yaml.org,2002:")
        if kind not in _PLAIN:
            raise self._error(path, node, f"tags such as !!{kind} are not accepted")
        if isinstance(node.value, str):
            is_null = node.value in _NULLS and getattr(node, "style", None) is None
            return None if is_null else node.value
        if kind == "seq":
            return [self.read(item, step_into(path, index)) for index, item in enumerate(node.value)]
        return self._mapping(node, path)

    def _mapping(self, node: yaml.Node, path: str) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key_node, value in node.value:
            key = key_node.value
            if not isinstance(key, str):
                raise self._error(path, key_node, "keys must be plain words")
            inside = step_into(path, key)
            if key in found:
                first = self.lines[inside]
                raise self._error(inside, key_node, f"the key '{key}' occurs twice, first in line {first}")
            self.lines[inside] = self._line(key_node)
            found[key] = self.read(value, inside)
        return found

    @staticmethod
    def _line(node: yaml.Node) -> int:
        return int(node.start_mark.line) + 1

    def _error(self, path: str, node: yaml.Node, problem: str) -> InputError:
        return InputError(f"{problem} (line {self._line(node)})", source=self.source, element=path or None)
