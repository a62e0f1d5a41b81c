"""Linkages that move although counting says that they cannot: one freedom, and the rank that the oracle finds."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

import echelon as ec
from echelon.regressor.loops.assembly import Assembly
from support.closed_states import read
from support.described_linkage import described
from support.loop_oracle import rank

GRAVITY = ("1.2", "-3.4", "-9.1")


@dataclass(frozen=True)
class Ring:
    """Revolute joints in a ring; sides, twists in degrees and offsets lie between one axis and the next.

    Sides are numbers with multiples of √3: (0.2, 0.1) is 0.2 + 0.1 √3.
    """

    sides: tuple[float | tuple[float, float], ...]
    twists: tuple[int, ...]
    offsets: tuple[float, ...] = (0.0,) * 6

    @property
    def text(self) -> str:
        sides = [f"{a}" if isinstance(a, float) else f"{a[0]} + {a[1]}*sqrt(3)" for a in self.sides]
        links = [
            f"{{xyz: [{a}, 0, {r}], rpy: [{t}*pi/180, 0, 0]}}"
            for a, t, r in zip(sides, self.twists, self.offsets, strict=False)
        ]
        last, angle, offset = sides[-1], f"{self.twists[-1]}*pi/180", self.offsets[len(sides) - 1]
        ground = f"[-({last}), -({offset})*sin({angle}), -({offset})*cos({angle})]"
        bodies = ["{name: b0, joint: {type: revolute, axis: z}}"]
        bodies += [
            f"{{name: b{k + 1}, parent: b{k}, joint: {{type: revolute, axis: z, origin: {link}}}}}"
            for k, link in enumerate(links[:-2])
        ]
        closure = f"at: {links[-2]}, on_second: {{xyz: {ground}, rpy: [-{angle}, 0, 0]}}"
        return "\n".join(
            [
                f"gravity: [{', '.join(GRAVITY)}]",
                "bodies:",
                *(f"  - {body}" for body in bodies),
                f"loops: [{{joint: revolute, connects: [b{len(bodies) - 1}, base], {closure}}}]",
            ]
        )


RINGS = {
    "Bennett": Ring((0.2, 0.4, 0.2, 0.4), (30, 90, 30, 90)),
    "Goldberg, five bars": Ring((0.4, 0.2, (0.0, 0.2), 0.4, (0.2, 0.2)), (90, 30, 60, 90, 90)),
    "Bricard, trihedral": Ring((0.3, 0.4, 0.4, 0.5, 0.5, 0.3), (90, 270, 90, 270, 90, 270)),
    "Bricard, symmetric about a line": Ring((0.3, 0.4, 0.25) * 2, (60, 45, 105) * 2),
    "Bricard, symmetric about a plane": Ring(
        (0.3, 0.4, 0.25, 0.25, 0.4, 0.3), (60, 45, 105, -105, -45, -60), (0.0, 0.1, -0.05, 0.0, 0.05, -0.1)
    ),
    "Schatz": Ring((0.0, 0.2, 0.2, 0.2, 0.0, (0.0, 0.2)), (90, 90, 90, 90, 90, 0), (0.1, 0.0, 0.0, 0.0, 0.0, -0.1)),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * name.startswith("Bricard")) for name in RINGS]
)
def test_mobility_and_rank(name: str) -> None:
    ring = RINGS[name]
    mechanism = read(ring.text)
    assert mechanism.degrees_of_freedom == 1
    pose = ", ".join(f"{n}: {x:.15f}" for n, x in zip(mechanism.positions, Assembly(mechanism).pose, strict=True))
    found = rank(described(f"{ring.text}\nassembly: {{{pose}}}\n"))
    assert (found.freedom, found.rank) == (1, ec.base_structure(mechanism).rank)
