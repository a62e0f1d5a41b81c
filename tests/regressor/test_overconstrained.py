"""Linkages that move although counting says that they cannot: their freedoms, and the rank that the oracle finds."""

from __future__ import annotations

import warnings
from contextlib import nullcontext
from dataclasses import dataclass
from math import pi

import pytest

import echelon as ec
from echelon.loops.assembly import Assembly
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
    pose: tuple[float, ...] = ()  # near which it closes
    freedom: int = 1

    @property
    def text(self) -> str:
        sides = [
            f"{a}" if isinstance(a, float) else f"{a[0]} + {a[1]}*sqrt(3)"
            for a in self.sides
        ]
        links = [
            f"{{xyz: [{a}, 0, {r}], rpy: [{t}*pi/180, 0, 0]}}"
            for a, t, r in zip(sides, self.twists, self.offsets, strict=False)
        ]
        last, angle, offset = (
            sides[-1],
            f"{self.twists[-1]}*pi/180",
            self.offsets[len(sides) - 1],
        )
        ground = f"[-({last}), -({offset})*sin({angle}), -({offset})*cos({angle})]"
        bodies = ["{name: b0, joint: {type: revolute, axis: z}}"]
        bodies += [
            f"{{name: b{k + 1}, parent: b{k}, joint: {{type: revolute, axis: z, origin: {link}}}}}"
            for k, link in enumerate(links[:-2])
        ]
        closure = (
            f"at: {links[-2]}, on_second: {{xyz: {ground}, rpy: [-{angle}, 0, 0]}}"
        )
        pose = ", ".join(f"b{k}: {x:.9f}" for k, x in enumerate(self.pose))
        return "\n".join(
            [
                f"gravity: [{', '.join(GRAVITY)}]",
                "bodies:",
                *(f"  - {body}" for body in bodies),
                f"loops: [{{joint: revolute, connects: [b{len(bodies) - 1}, base], {closure}}}]",
                f"assembly: {{{pose}}}",
            ]
        )


RINGS = {
    "Bennett": Ring((0.2, 0.4, 0.2, 0.4), (30, 90, 30, 90)),
    "Goldberg, five bars": Ring(
        (0.4, 0.2, (0.0, 0.2), 0.4, (0.2, 0.2)), (90, 30, 60, 90, 90)
    ),
    "Goldberg, six bars in a row": Ring(
        (0.4, 0.2, 0.2, (0.0, 0.2), 0.4, (0.4, 0.2)),
        (90, 30, 30, 60, 90, 120),
        pose=(2.249, -1.384, -1.032, -1.389, -1.217),
    ),
    "Goldberg, two of five bars": Ring(
        ((0.0, 0.2), 0.4, (0.2, 0.2), 0.4, 0.4, 0.2),
        (60, 90, 90, 60, 90, 30),
        pose=(2.766, -1.159, 2.795, -3.142, -2.419),
    ),
    "Myard": Ring(
        (0.1, 0.2, 0.0, 0.2, 0.1),
        (30, 90, 120, 90, 150),
        pose=(0.054, 2.071, 1.544, -1.598),
    ),
    "Bricard, symmetric in three": Ring(
        (0.3,) * 6, (60, -60) * 3, pose=(-0.72, -1.664, -0.72, -1.664, -0.72)
    ),
    "folded twice onto itself": Ring(
        (0.3,) * 6, (60,) * 6, pose=(-pi, 0.952, 0.903, pi, -0.903), freedom=2
    ),
    "Bricard, trihedral": Ring(
        (0.3, 0.4, 0.4, 0.5, 0.5, 0.3), (90, 270, 90, 270, 90, 270)
    ),
    "Bricard, symmetric about a line": Ring((0.3, 0.4, 0.25) * 2, (60, 45, 105) * 2),
    "Bricard, octahedral": Ring(
        (0.0,) * 6, (60, 75, 105) * 2, (0.3, 0.4, 0.25, -0.3, -0.4, -0.25)
    ),
    "Altmann": Ring((0.3, 0.0, 0.4) * 2, (90, 90, 270) * 2),
    "Wohlhart": Ring(
        (0.3, 0.3, 0.4, 0.4, 0.35, 0.35),
        (60, 300, 75, 285, 105, 255),
        (0.1, 0.0, 0.05, 0.0, -0.15, 0.0),
    ),
    "Bricard, symmetric about a plane": Ring(
        (0.3, 0.4, 0.25, 0.25, 0.4, 0.3),
        (60, 45, 105, -105, -45, -60),
        (0.0, 0.1, -0.05, 0.0, 0.05, -0.1),
    ),
    "Schatz": Ring(
        (0.0, 0.2, 0.2, 0.2, 0.0, (0.0, 0.2)),
        (90, 90, 90, 90, 90, 0),
        (0.1, 0.0, 0.0, 0.0, 0.0, -0.1),
    ),
}


QUICK = ("Bennett",)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] * (name not in QUICK))
        for name in RINGS
    ],
)
def test_mobility_and_rank(name: str) -> None:
    ring = RINGS[name]
    mechanism = read(ring.text)
    pose = ", ".join(
        f"{n}: {x:.15f}"
        for n, x in zip(mechanism.positions, Assembly(mechanism).pose, strict=True)
    )
    found = rank(
        described(
            ring.text.replace(ring.text.splitlines()[-1], f"assembly: {{{pose}}}")
        )
    )
    assert found.freedom == mechanism.degrees_of_freedom == ring.freedom
    assert found.rank == ec.base_structure(mechanism).rank


REFUSED = {
    "no length of sides satisfies the condition": (
        Ring((0.2, 0.5, 0.6, 0.35, 0.45, 0.0), (90, 270) * 3).text,
        r"'loop1' \(b4 and the base\) leave no motion: that of '.*' is stopped by 'loop1' \(singular value 0\.\d+",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_rings_that_do_not_move_are_refused(name: str) -> None:
    text, message = REFUSED[name]
    with pytest.raises(ec.InputError, match=message):
        read(text)


@pytest.mark.slow
def test_a_ring_with_a_side_that_is_off_by_the_last_decimal_moves_as_meant() -> None:
    ring = Ring((0.2, 0.4, 0.2, 0.4), (30, 90, 30, 90)).text
    mechanism = read(ring.replace("0.4", "0.40001", 1))
    assert mechanism.degrees_of_freedom == 1
    with pytest.warns(ec.DoubtWarning) if _is_unclear(mechanism) else nullcontext():
        assert ec.base_structure(mechanism).rank == ec.base_structure(read(ring)).rank


def _is_unclear(mechanism: ec.Mechanism) -> bool:
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        ec.base_structure(mechanism)
    return bool(seen)


def test_a_rigid_assembly_is_refused_with_one_that_moves() -> None:
    """Some closed poses of a ring that is symmetric about a line are not, and rigid."""
    ring = Ring((0.2, 0.5, 0.3) * 2, (30, 75, 120) * 2, (0.1, -0.2, 0.05) * 2)
    rigid = "assembly: {b0: -2.311112846, b1: -0.576249803, b2: -0.922674918, b3: 2.285133707, b4: 0.629380441}"
    with pytest.raises(
        ec.InputError, match=r"leave no motion.*They move .* write  assembly: "
    ) as refused:
        read(ring.text.replace("assembly: {}", rigid))
    written = str(refused.value).partition("write  ")[2]
    assert read(ring.text.replace("assembly: {}", written)).degrees_of_freedom == 1
