"""YAML as plain data, scalar by scalar as written.

PyYAML is used only as far as its events.  Its own conversion would turn ``0.0825`` into a float, ``010`` into eight and
``no`` into False, would accept duplicate keys, and calls itself for each level.  Aliases and merge keys are refused,
because a few of them can make a small file expand without bounds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from echelon.errors import InputError, one_line
from echelon.inputs.content import DATA_NODES, DEPTH, SLOW_NODES, Limit, decoded

if TYPE_CHECKING:
    import yaml

_NULLS = frozenset({"", "~", "null", "Null", "NULL"})
_TAG = "tag:yaml.org,2002:"
_PLAIN = frozenset({None, "!", *(_TAG + kind for kind in ("str", "seq", "map"))})


@dataclass
class YamlDocument:
    """One document of a text."""

    data: Any = None  # mappings, lists, texts and None
    lines: dict[str, int] = field(default_factory=dict)  # line, counted from 1, of every element by its path


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

    text = str(yaml.safe_dump(data, default_flow_style=True, sort_keys=False, allow_unicode=True, width=float("inf")))
    return text.strip()[1:-1] if isinstance(data, dict) and len(data) == 1 else text.strip()


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
    reader = _Reader(source, nodes, lines)
    try:
        for event in yaml.parse(text, yaml.CBaseLoader if yaml.__with_libyaml__ else yaml.BaseLoader):
            reader.take(event)
    except yaml.MarkedYAMLError as error:
        raise InputError(_syntax_problem(error, text), source=source) from None
    except (yaml.YAMLError, ValueError) as error:
        problem = one_line((str(error).splitlines() or [""])[0])
        raise InputError(f"not readable as YAML: {problem}", source=source) from None
    return reader.documents


def _syntax_problem(error: yaml.MarkedYAMLError, text: str) -> str:
    mark = error.problem_mark or error.context_mark
    line = min(mark.line + 1, text.count("\n") + (not text.endswith("\n"))) if mark else 0  # not behind the end
    where = f" (line {line}, column {mark.column + 1})" if mark else ""
    problem = error.problem or error.context or "syntax error"
    if "cannot start any token" in problem and "\t" in text:
        problem = "tabs cannot indent; use spaces"
    return f"not well-formed YAML: {problem}{where}"


@dataclass
class _Open:
    """A list or mapping that has begun: its data, its path, and the key whose value comes next."""

    data: Any
    path: str
    key: str | None = None


class _Reader:
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
        raise self._error(self._place(), event, "aliases (*name) are not accepted; write the value out")

    def _scalar(self, event: Any) -> None:
        self._check(event)
        within = self._open[-1] if self._open else None
        if within is not None and isinstance(within.data, dict) and within.key is None:
            self._key(within, event)
        else:
            self._put(event, None if event.value in _NULLS and not event.style else event.value)

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
        if self._open and isinstance(self._open[-1].data, dict) and self._open[-1].key is None:
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
            shown = one_line(event.tag.removeprefix(_TAG))
            raise self._error(self._place(), event, f"tags such as !!{shown} are not accepted")

    def _error(self, path: str, event: Any, problem: str) -> InputError:
        return InputError(
            f"{one_line(problem)} (line {_line(event)})", source=self._source, element=one_line(path) or None
        )


def _line(event: Any) -> int:
    return int(event.start_mark.line) + 1
