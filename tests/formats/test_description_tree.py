"""Descriptions: what is fixed rides along, what floats, and expressions of any length."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from echelon.algebra.exact.expressions import parse
from echelon.formats.snapping import ReadingOptions
from echelon.robot.mechanism import Mechanism
from echelon.shared.errors import InputError
from support.descriptions import read_description
from support.textbook_poses import Array, X, moved, pose_of, turned


def read(text: str, **options: Any) -> Mechanism:
    return read_description(
        f"echelon: 1\n{text}", "robot.yaml", ReadingOptions(**options)
    )


# -- fixed parts ------------------------------------------------------------------------------------------------------


def point_mass(mass: float, place: Sequence[float]) -> Array:
    p = np.array(place, dtype=float)
    tensor = mass * (p @ p * np.eye(3) - np.outer(p, p))
    return np.array([*tensor[np.triu_indices(3)], *(mass * p), mass])


TOOL = """
symbols: {l: 0.3, beta: VALUE}
bodies:
  - name: hand
    joint: {type: revolute, axis: z}
    inertial: {mass: 2, com: [0.1, 0, 0], inertia: {xx: 0, yy: 0, zz: 0}}
  - name: flange
    parent: hand
    joint: {type: fixed, origin: {xyz: [0, 0, l], rpy: [beta, 0, 0]}}
  - name: tool
    parent: flange
    joint: {type: fixed, origin: {xyz: [0, 0.5, 0]}}
    inertial: {mass: 3, com: [0, 0, 0.2], inertia: {xx: 0, yy: 0, zz: 0}}
"""


def test_what_is_fixed_rides_along() -> None:
    hand = read(TOOL.replace("VALUE", "pi/6")).bodies[0]
    place = moved(0, 0, 0.3) @ turned(X, np.pi / 6) @ [0, 0.5, 0.2, 1]
    assert hand.inertial is not None
    np.testing.assert_allclose(
        hand.inertial, point_mass(2, [0.1, 0, 0]) + point_mass(3, place[:3]), atol=1e-12
    )


def test_inertial_values_at_a_symbolic_place_are_unknown() -> None:
    mechanism = read(TOOL.replace("VALUE", "null"))
    assert mechanism.bodies[0].inertial is None
    assert mechanism.reading is not None
    assert "'tool'" in " ".join(mechanism.reading.notes)


def test_fixed_parts_can_be_kept_apart() -> None:
    text = TOOL.replace("VALUE", "null")
    apart = read(text.replace("- name: tool", "- name: tool\n    separate: true"))
    assert [body.name for body in apart.bodies] == ["hand", "tool"]
    assert [body.name for body in read(text, keep_fixed_links=True).bodies] == [
        "hand",
        "flange",
        "tool",
    ]


def test_labels_do_not_depend_on_whether_the_base_is_kept() -> None:
    text = "bodies: [{name: stand}, {name: arm, parent: stand, joint: {type: revolute, axis: z}}]"
    assert [body.label for body in read(text).bodies] == ["1"]
    assert [body.label for body in read(text, keep_fixed_links=True).bodies] == [
        "0",
        "1",
    ]
    assert [body.label for body in read(text, floating=True).bodies] == ["0", "1"]


def test_a_massless_body_gets_the_mass_of_what_it_carries() -> None:
    text = TOOL.replace("VALUE", "0.2")
    assert not read(text, massless=("hand",)).bodies[0].massless
    assert not read(text, massless=("flange", "tool")).bodies[0].massless
    assert read(text, massless=("hand", "flange", "tool")).bodies[0].massless


# -- floating base ----------------------------------------------------------------------------------------------------

ARM = "{name: arm, PARENT joint: {type: revolute, axis: z, origin: {xyz: [1, 0, 0]}}}"
FLOATS = {
    "table": ("modified_dh: [{joint: revolute}]", ["base", "j1"], ["0", "1"]),
    "first part moves": (f"bodies: [{ARM}]", ["base", "arm"], ["0", "1"]),
    "first part is the base": (
        f"bodies: [{{name: trunk}}, {ARM}]",
        ["trunk", "arm"],
        ["0", "1"],
    ),
    "no bodies": ("bodies: []", ["base"], ["0"]),
}


@pytest.mark.parametrize("case", FLOATS)
def test_floating_base(case: str) -> None:
    text, names, labels = FLOATS[case]
    text = text.replace("PARENT", "")
    for mechanism in (read(text, floating=True), read(f"floating_base: true\n{text}")):
        assert [body.name for body in mechanism.bodies] == names
        assert [body.label for body in mechanism.bodies] == labels
        assert mechanism.velocities[:6] == (
            "base.tx",
            "base.ty",
            "base.tz",
            "base.r.x",
            "base.r.y",
            "base.r.z",
        )
        assert [body.parent for body in mechanism.bodies] == [-1, 0][: len(names)]


def test_a_base_that_floats_already_is_not_set_free_again() -> None:
    text = f"bodies: [{{name: trunk, joint: {{type: floating}}}}, {ARM.replace('PARENT', 'parent: trunk,')}]"
    assert read(text).degrees_of_freedom == 7
    for stated, options in (
        (text, {"floating": True}),
        (f"floating_base: true\n{text}", {}),
    ):
        with pytest.raises(
            InputError,
            match="body 'trunk' floats already, by its own joint: leave floating_base",
        ):
            read(stated, **options)


def test_what_hangs_on_a_floating_base_keeps_its_place() -> None:
    text = f"floating_base: true\nbodies: [{{name: trunk, joint: {{type: fixed, origin: {{xyz: [0, 2, 0]}}}}}}, {ARM}]"
    pose = pose_of(read(text.replace("PARENT", "")), 1, {"arm": 0.0})
    np.testing.assert_allclose(pose[:3, 3], [1, -2, 0])


def test_effects_at_all_leave_a_floating_base_out() -> None:
    robot = read(
        f"floating_base: true\nbodies: [{ARM.replace('PARENT', '')}]\neffects: [{{type: coulomb, at: all}}]"
    )
    assert [effect.parameter for effect in robot.effects] == ["Fc1"]


# -- long expressions -------------------------------------------------------------------------------------------------


def test_long_sums_are_read() -> None:
    names = [f"s{k}" for k in range(2000)]
    total = parse(" - ".join(f"(1 + sqrt(2))*{name}" for name in names))
    assert total.symbols() == sorted(names)
    spaced = parse("a * - b + " * 200 + "2 * (c - d) ^ 2")
    assert spaced == parse("-200*a*b + 2*c^2 - 4*c*d + 2*d^2")


def test_expressions_cannot_grow_without_bounds() -> None:
    with pytest.raises(InputError, match="terms"):
        read(
            "symbols: {a: 1, b: 1, c: 1, d: 1}\nmodified_dh: [{joint: revolute, a: (a + b + c + d)^32}]"
        )
    with pytest.raises(InputError, match="beyond the range"):
        read("modified_dh: [{joint: revolute, a: (9^32)^32}]")


def test_messages_are_one_short_line() -> None:
    with pytest.raises(InputError) as caught:
        read('modified_dh: [{joint: revolute, a: "x\\n' + "y" * 5000 + '"}]')
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 800
