"""The columns that a set-up file states: templates filled in, numbers evaluated, names checked."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from echelon.exact.expressions import PI, parse
from echelon.exact.polynomial import symbol_of
from echelon.formats.description.document import Document
from echelon.hints import nearest, nearest_of
from echelon.logs.columns.column_map import Channel, ColumnMap
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import known_values

if TYPE_CHECKING:
    from echelon.formats.schema.schema_log import Column, ColumnEntry, Columns, LogEntry

_FIELD = re.compile(r"\{(?:(\d+) *\* *)?(n|i|name)(?: *([+-]) *(\d+))?\}")

EVERY, DRIVES = "all", "actuators"
"""Keys that stand for every coordinate (or output), and for every drive."""


def stated_columns(log: LogEntry, mechanism: Mechanism, document: Document, path: str = "log") -> ColumnMap:
    """What a ``log`` section of a description says."""
    return _Columns(mechanism, document, path).read(log)


class _Columns:
    def __init__(self, mechanism: Mechanism, document: Document, path: str) -> None:
        self.mechanism, self.document, self.path = mechanism, document, path
        self.drives = tuple(a.name for a in mechanism.transmission.actuators)
        self.known = {**known_values(mechanism), PI: math.pi}

    def read(self, log: LogEntry) -> ColumnMap:
        positions = independent(self.mechanism.positions, self.mechanism)
        velocities = independent(self.mechanism.velocities, self.mechanism)
        outputs = tuple(output.name for output in self.mechanism.outputs)
        return ColumnMap(
            None if log.time is None else self._channel(log.time, f"{self.path}.time", {}),
            log.rate,
            self._channels(log.position, "position", positions),
            self._channels(log.velocity, "velocity", velocities),
            self._channels(log.acceleration, "acceleration", velocities),
            self._channels(log.output, "output", outputs),
            self._channels(log.reference, "reference", positions),
            self._channels(log.input, "input", velocities),
        )

    def _channels(self, columns: Columns | None, key: str, names: Sequence[str]) -> dict[str, Channel]:
        """The channels of one quantity by coordinate, output or drive; what is stated by name comes before all."""
        if columns is None:
            return {}
        if isinstance(columns, str):
            return dict(self._filled(columns, f"{self.path}.{key}", names))
        found: dict[str, Channel] = {}
        for name, entry in columns.items():
            path = f"{self.path}.{key}.{name}"
            if name in (EVERY, DRIVES):
                found |= dict(self._filled(entry, path, names if name == EVERY else self.drives))
        for name, entry in columns.items():
            path = f"{self.path}.{key}.{name}"
            if name not in (EVERY, DRIVES):
                valid = [*names, *self.drives]
                if name not in valid:
                    problem = f"there is no such coordinate, output or drive{nearest_of(name, [*valid, EVERY, DRIVES])}"
                    raise self.document.error(path, problem)
                found[name] = self._channel(entry, path, {"name": name})
        return found

    def _filled(self, entry: Column, path: str, names: Iterable[str]) -> Iterator[tuple[str, Channel]]:
        for i, name in enumerate(names):
            yield name, self._channel(entry, path, {"n": i + 1, "i": i, "name": name})

    def _channel(self, entry: Column, path: str, fields: Mapping[str, object]) -> Channel:
        if isinstance(entry, str):
            return Channel(self._column(entry, path, fields))
        column = self._column(entry.column, f"{path}.column", fields)
        return Channel(column, entry.unit, *(self._number(entry, part, path) for part in ("scale", "offset")))

    def _column(self, template: str, path: str, fields: Mapping[str, object]) -> str:
        """A column's name; braces that name no field belong to the name, and numbers may be shifted: ``{n+12}``."""

        def filled(found: re.Match[str]) -> str:
            times, field, sign, more = found.groups()
            if field not in fields:
                return found.group()
            value = fields[field]
            if isinstance(value, int):
                return str(int(times or 1) * value + int(f"{sign or ''}{more or 0}"))
            return found.group() if times or sign else str(value)

        name = _FIELD.sub(filled, template)
        if "n" in fields and name == template and fields["n"] != 1:
            problem = f"'{template}' is one column for several channels: use {{n}}, {{i}} or {{name}}"
            raise self.document.error(path, problem)
        return name

    def _number(self, entry: ColumnEntry, part: str, path: str) -> float:
        text, place = str(getattr(entry, part)), f"{path}.{part}"
        try:
            value = parse(text)
        except ValueError as error:
            raise self.document.error(place, str(error)) from None
        for generator in value.generators():
            if symbol_of(generator) not in self.known:
                hint = nearest(symbol_of(generator), self.known)
                raise self.document.error(place, f"'{symbol_of(generator)}' in '{text}' has no value{hint}")
        number = value.at(self.known)
        if not math.isfinite(number) or (part == "scale" and number == 0):
            raise self.document.error(
                place, f"'{text}' is {number}; a {part} must be finite" + " and not zero" * (not number)
            )
        return number


def independent(names: Sequence[str], mechanism: Mechanism) -> tuple[str, ...]:
    """Coordinates that have to be measured: those that no coupling and no loop makes dependent."""
    return tuple(name for name in names if not mechanism.closures or name in mechanism.independent_velocities)
