"""Linkages for `loop_oracle` from descriptions: the package's format, read here by its documentation alone.

Covered are `modified_dh` and `bodies` with all plain joints, `loops` of all kinds, polynomial `couplings`, `assembly`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, reduce
from operator import mul

import numpy as np
import sympy
import yaml
from flint import arb, arb_mat

from support.loop_linkage import (
    ONE,
    Body,
    Linkage,
    Loop,
    function,
    number,
    sliding,
    turning,
)
from support.loop_readers import AXES, FREE, euler, placed, turned

ALIASES = {
    "spherical": "point",
    "points": "point",
    "cylindrical": "axis",
    "axes": "axis",
}
NAMED = {
    f"{sign}{letter}": [f"{sign}1" if k == letter else "0" for k in "xyz"]
    for letter in "xyz"
    for sign in ("", "-")
}
ZERO = ("0", "0", "0")


def described(text: str) -> Linkage:
    """The linkage that a description states."""
    return _Reader(yaml.load(text, yaml.BaseLoader)).linkage


@dataclass
class _Reader:
    robot: dict
    bodies: list[Body] = field(default_factory=list)
    tails: list[arb_mat] = field(
        default_factory=list
    )  # the frame of a body in the one that its motions move
    coordinates: list[str] = field(
        default_factory=list
    )  # of the motions; those of a ball are its name three times
    index: dict[str, int] = field(default_factory=lambda: {"base": -1, "0": -1})

    @cached_property
    def symbols(self) -> dict[str, sympy.Expr]:
        stated = self.robot.get("symbols", {}).items()
        values = {
            n: v.get("value", v.get("approximate")) if isinstance(v, dict) else v
            for n, v in stated
        }
        return {
            name: sympy.sympify(value, rational=True) for name, value in values.items()
        }

    def expression(self, text: str) -> sympy.Expr:
        return sympy.sympify(
            text.replace("^", "**"), locals=self.symbols, rational=True
        )

    def value(self, text: str) -> arb:
        return number(str(self.expression(text).evalf(85)))

    def values(self, texts: list[str]) -> list[arb]:
        return [self.value(text) for text in texts]

    def frame(self, frame: dict) -> arb_mat:
        turn = turned(*self.values(frame.get("rpy", ZERO)))
        if "rotation" in frame:
            turn = [self.values(row) for row in frame["rotation"]]
        return placed(turn, self.values(frame.get("xyz", ZERO)))

    def axis(self, axis: str | list[str]) -> list[arb]:
        return self.values(NAMED[axis] if isinstance(axis, str) else axis)

    @cached_property
    def linkage(self) -> Linkage:
        for row in self.robot.get("modified_dh", ()):
            self._row(row)
        for body in self.robot.get("bodies", ()):
            self._body(body)
        start = self._start()
        unlooped = Linkage(tuple(self.bodies), (), start)
        gravity = tuple(self.values(self.robot.get("gravity", ("0", "0", "-9.81"))))
        at_zero = unlooped.state([arb(0)] * len(start), [arb(0)] * len(start)).poses
        loops = tuple(
            self._loop(entry, at_zero) for entry in self.robot.get("loops", ())
        )
        return Linkage(tuple(self.bodies), loops, start, tuple(self._ties()), gravity)

    def _add(
        self,
        entry: dict,
        parent: int,
        pose: arb_mat,
        motions: dict[str, arb_mat],
        tail: arb_mat = ONE,
    ) -> None:
        name = entry.get("name", f"j{len(self.bodies) + 1}")
        self.index[name] = len(self.bodies)
        mount = ONE if parent < 0 else self.tails[parent]
        self.bodies.append(Body(name, parent, mount * pose, tuple(motions.values())))
        self.tails.append(tail)
        self.coordinates += [end.partition("#")[0] for end in motions]

    def _row(self, row: dict) -> None:
        alpha, a, theta, d, gamma, b = (
            row.get(key, "0") for key in ("alpha", "a", "theta", "d", "gamma", "b")
        )
        steps = (
            {"rpy": ("0", "0", gamma)},
            {"xyz": ("0", "0", b), "rpy": (alpha, "0", "0")},
            {"xyz": (a, "0", "0"), "rpy": ("0", "0", theta)},
            {"xyz": ("0", "0", d)},
        )
        pose = reduce(mul, map(self.frame, steps))
        motion = {"revolute": turning(AXES[2]), "prismatic": sliding(AXES[2])}.get(
            row["joint"]
        )
        parent = self.index[row["parent"]] if "parent" in row else len(self.bodies) - 1
        self._add(
            row,
            parent,
            pose,
            {}
            if motion is None
            else {row.get("name", f"j{len(self.bodies) + 1}"): motion},
        )

    def _body(self, body: dict) -> None:
        joint = body["joint"]
        name = joint.get("name", body["name"])
        parent = self.index[body.get("parent", "base")]
        self._add(
            body,
            parent,
            self.frame(joint.get("origin", {})),
            self._motions(joint, name),
            self.frame(body.get("frame", {})),
        )

    def _motions(self, joint: dict, name: str) -> dict[str, arb_mat]:
        axis = self.axis(joint["axis"]) if "axis" in joint else None
        match joint["type"]:
            case "fixed":
                return {}
            case "revolute" | "continuous":
                return {name: turning(axis)}
            case "prismatic":
                return {name: sliding(axis)}
            case "cylindrical":
                return {f"{name}.slide": sliding(axis), f"{name}.turn": turning(axis)}
            case "helical":
                return {
                    name: turning(axis) + sliding(axis) * self.value(joint["pitch"])
                }
            case "universal":
                return {
                    f"{name}.1": turning(axis),
                    f"{name}.2": turning(self.axis(joint["axis2"])),
                }
            case "planar" if joint["axis"] == "z":
                return {
                    f"{name}.x": sliding(AXES[0]),
                    f"{name}.y": sliding(AXES[1]),
                    f"{name}.angle": turning(axis),
                }
            case "spherical":
                return {f"{name}#{k}": turning(AXES[k]) for k in range(3)}
            case "floating":
                ends = [
                    *(f".t{letter}" for letter in "xyz"),
                    *(f".r#{k}" for k in range(3)),
                ]
                return {
                    f"{name}{end}": motion
                    for end, motion in zip(ends, FREE, strict=True)
                }
        raise NotImplementedError(joint["type"])

    def _start(self) -> tuple[float, ...]:
        stated = self.robot.get("assembly", {})
        found: list[float] = []
        for name in self.coordinates:
            if f"{name}.w" in stated or (
                f"{name}.x" in stated and self.coordinates.count(name) == 3
            ):
                turn = euler(
                    np.array(
                        [
                            float(self.value(stated.get(f"{name}.{c}", "0")))
                            for c in "wxyz"
                        ]
                    )
                )
                found.append(
                    turn[len([n for n in self.coordinates[: len(found)] if n == name])]
                )
            else:
                found.append(float(self.value(stated.get(name, "0"))))
        for dependent, terms, constant in self._couplings():
            at = dict(zip(self.coordinates, found, strict=True))
            moved = [float(function(c, arb(at[n]))[0]) for n, c in terms.items()]
            found[self.coordinates.index(dependent)] = constant + sum(moved)
        return tuple(found)

    def _couplings(self) -> list[tuple[str, dict[str, tuple[float, ...]], float]]:
        """Dependent coordinates with the coefficients of polynomials in others, and constants."""
        found = []
        for entry in self.robot.get("couplings", ()):
            for dependent, text in entry.items():
                whole = self.expression(text)
                names = [
                    n for n in self.coordinates if sympy.Symbol(n) in whole.free_symbols
                ]
                stands = {sympy.Symbol(name): 0 for name in names}
                terms = {}
                for name in names:
                    x = sympy.Symbol(name)
                    alone = sympy.Poly(whole.subs({s: 0 for s in stands if s != x}), x)
                    terms[name] = tuple(
                        float(alone.coeff_monomial(x**k))
                        for k in range(1, alone.degree() + 1)
                    )
                found.append((dependent, terms, float(whole.subs(stands))))
        return found

    def _ties(self) -> list[dict[int, object]]:
        places = self.coordinates.index
        return [
            {places(d): 1.0}
            | {places(n): tuple(-x for x in c) for n, c in terms.items()}
            for d, terms, _ in self._couplings()
        ]

    def _loop(self, entry: dict, at_zero: list[arb_mat]) -> Loop:
        first, second = (self.index[name] for name in entry["connects"])
        one, two = (ONE if body < 0 else self.tails[body] for body in (first, second))
        aim = self._aim(self.axis(entry.get("axis", "z")))
        at = one * self.frame(entry.get("at", {})) * aim
        on = (at_zero[second]).inv() * at_zero[first] * at
        if "on_second" in entry:
            on = two * self.frame(entry["on_second"]) * aim
        return Loop(ALIASES.get(entry["joint"], entry["joint"]), first, second, at, on)

    def _aim(self, axis: list[arb]) -> arb_mat:
        """A frame whose z lies along an axis."""
        x, y, z = axis
        tilt, turn = (
            arb.atan2((x * x + y * y).sqrt(), z),
            arb.atan2(y, x) if x != 0 or y != 0 else arb(0),
        )
        return placed(turned(arb(0), tilt, turn), [arb(0)] * 3)
