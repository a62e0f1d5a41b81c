"""Sensors of MJCF that measure forces: of joints, of actuators, and between a body and its parent at a site."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

from echelon.exact.numbers import parse_decimal
from echelon.formats.literal import LiteralEffort, LiteralSensor, LiteralWrench
from echelon.formats.mjcf_loops import site_frame
from echelon.formats.mjcf_spec import import_mujoco

_WRENCHES = {"mjSENS_FORCE": False, "mjSENS_TORQUE": True}


class Sensors:
    """The sensors of a spec, kept while it is compiled without them."""

    def __init__(self, spec: Any) -> None:
        self.notes: list[str] = []
        self._sites = {site.name: site for site in spec.sites}
        self._drives = {actuator.name: actuator for actuator in spec.actuators}
        self._driven = Counter(str(actuator.target) for actuator in spec.actuators if _direct(actuator))
        self._wrenches: list[tuple[str, str, Any, bool]] = []
        self._efforts: list[LiteralEffort] = []
        self._taken: set[str] = {sensor.name for sensor in spec.sensors if sensor.name}
        others: Counter[str] = Counter()
        for sensor in spec.sensors:
            kind, target = str(sensor.type.name), str(sensor.objname)
            label = f"sensor {kind.removeprefix('mjSENS_').lower()} '{sensor.name or target}'"
            if kind in _WRENCHES:
                name = self._named(sensor.name, target)
                self._wrenches.append((label, name, self._sites[target], _WRENCHES[kind]))
            elif kind == "mjSENS_JOINTACTFRC":
                self._efforts.append(LiteralEffort(label, self._named(sensor.name, target), target))
            elif kind == "mjSENS_ACTUATORFRC":
                self._efforts += self._of_actuator(label, self._named(sensor.name, target), self._drives[target])
            else:
                others[kind.removeprefix("mjSENS_").lower()] += 1
        if others and (self._wrenches or self._efforts):
            counts = ", ".join(f"{kind} ({count})" for kind, count in sorted(others.items()))
            self.notes.append(f"sensors of other quantities than drive forces and wrenches are left out: {counts}")

    def read(self, model: Any) -> Iterator[LiteralSensor]:
        """Those that measure forces, in terms of the compiled model."""
        for label, name, site, angular in self._wrenches:
            link, placements = site_frame(model, site, label)
            if link:
                yield LiteralWrench(label, name, link, placements, angular)
            else:
                self.notes.append(f"{label} is left out: the world has no parent")
        yield from self._efforts

    def _named(self, stated: str, target: str) -> str:
        """The sensor's name, or one after what it is on."""
        if stated:
            return str(stated)
        name = target
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        return name

    def _of_actuator(self, label: str, name: str, actuator: Any) -> Iterator[LiteralEffort]:
        joint, gear = str(actuator.target), parse_decimal(repr(float(actuator.gear[0])))
        if not _direct(actuator):
            self.notes.append(f"{label} is left out: it does not drive a joint directly")
        elif self._driven[joint] > 1:
            self.notes.append(f"{label} is left out: joint '{joint}' has other actuators, too")
        elif not gear:
            self.notes.append(f"{label} is left out: its gear is zero")
        else:
            yield LiteralEffort(label, name, joint, 1 / Fraction(gear))


def _direct(actuator: Any) -> bool:
    kinds = import_mujoco().mjtTrn
    return actuator.trntype in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT)
