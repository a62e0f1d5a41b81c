"""Assembly modes in which the same parameters combine with different signs."""

from __future__ import annotations

import numpy as np
import pytest

import echelon as ec
from echelon.regressor.evaluate import evaluate_floats
from echelon.regressor.linear_forms import virtual_power_form
from echelon.regressor.loops.assembly import Assembly
from support.many_cranks import CRANKS, cranks, read
from support.selection import slow_unless
from support.zoo.mjcf_text import mjcf


@pytest.mark.parametrize(("second", "sign"), slow_unless([("-0.7", -1)], [("0.7", 1), ("-0.7", -1)]))
@pytest.mark.parametrize("numbers", [False, True])
def test_two_cranks_turn_the_same_way_or_opposite_ways(second: str, sign: int, numbers: bool) -> None:
    """With q2 = ±q1, the x components of what the second crank carries count with the sign."""
    mechanism = cranks(second, numbers)
    base = ec.base_parameters(mechanism)
    columns = {name: k for k, name in enumerate(base.parameters)}
    row = base.B_float()[base.pivots.index("MX1")]
    assert row[columns["MX2"]] == sign
    assert row[columns["M4"]] == pytest.approx(0.25 * sign)
    assert len(set(ec.assembly_modes(mechanism))) == 1 < len(ec.assembly_modes(mechanism))


@pytest.mark.parametrize("second", ["0.7", "-0.7"])
def test_forces_of_the_stated_assembly_follow_from_the_base_parameters(second: str) -> None:
    """X = X̄ B in doubles, on closed configurations near the stated one only."""
    mechanism = cranks(second)
    base = ec.base_parameters(mechanism)
    states = Assembly(mechanism).random_closed_states(np.random.default_rng(3), 20, 0.2)
    regressor = evaluate_floats(virtual_power_form(mechanism), mechanism, *states)
    reduced = regressor[:, :, list(base.matrix.pivots)]
    np.testing.assert_allclose(reduced @ base.B_float(), regressor, atol=1e-9)


@pytest.mark.slow
def test_every_combination_of_signs_is_a_mode() -> None:
    """Three cranks with one guide: q2 = ±q1 and q3 = ±q1."""
    text = CRANKS.replace("SECOND", "0.7").replace("first: 0.7", "first: 0.7, third: -0.7")
    text = text.replace(
        "  - {name: bob, parent: second, joint: {type: revolute, axis: z, origin: {xyz: [l, 0, 0]}}}\n",
        "  - {name: third, joint: {type: revolute, axis: z, origin: {xyz: [-d, 0, 0]}}}\n",
    ).replace(", bob]", "]")
    again = "  - {name: far, joint: point_on_plane, axis: x, connects: [guide, third], at: {xyz: [-d, 0, 0]}, ON}\n"
    mechanism = read(text.replace("independent:", again.replace("ON", "on_second: {xyz: [r, 0, 0]}") + "independent:"))
    base = ec.base_parameters(mechanism)
    assert "MX1 + MX2 − MX4" in [str(e) for e in base.expressions]
    assert len(ec.assembly_modes(mechanism)) == 4


@pytest.mark.parametrize(
    "change",
    [
        ("{r: 0.3, d: 0.8, l: 0.25}", "{r: {}, d: {}, l: {}}"),  # symbols without values
        ("assembly: {first: 0.7, second: 0.7, guide: 0.229}", ""),  # the modes meet where all coordinates are zero
    ],
)
def test_where_the_mode_cannot_be_told_it_is_said(change: tuple[str, str]) -> None:
    text = CRANKS.replace("SECOND", "0.7")
    assert change[0] in text
    with pytest.raises(ec.InputError, match="assembled in several ways"):
        ec.base_parameters(read(text.replace(*change)))


@pytest.mark.slow
def test_much_may_change_along_one_way() -> None:
    """A wheel carrier on five rods, as in cars: the one motion of the rods' ends shows most of 56 parameters."""
    ends = (
        ("-0.1 0.35 0.2", "-0.08 0.65 0.19"),
        ("0.15 0.36 0.21", "0.09 0.66 0.2"),
        ("-0.12 0.4 0.45", "-0.05 0.62 0.46"),
        ("0.1 0.41 0.47", "0.06 0.63 0.45"),
        ("0.2 0.3 0.3", "0.16 0.67 0.31"),
    )
    rods, closing = "", ""
    for k, (start, end) in enumerate(ends):
        rods += f'<body name="rod{k}" pos="{start}"><joint name="rod{k}" type="ball"/>INERTIA</body>'
        x, y, z = np.subtract(*(np.array(p.split(), float) for p in (end, start))).round(3)
        closing += f'<connect body1="rod{k}" body2="carrier" anchor="{x} {y} {z}"/>'
    wheel = '<body name="wheel" pos="0 0.02 0"><joint name="wheel" axis="0 1 0"/>INERTIA</body>'
    carrier = f"""<body name="carrier" pos="0 0.7 0.3" quat="0.833391 0.203109 0.304663 -0.413793">
      <freejoint name="carrier"/>INERTIA{wheel}</body>"""
    mechanism = ec.load(mjcf(rods + carrier, closing, "wheel"))
    assert (mechanism.degrees_of_freedom, ec.base_structure(mechanism).rank) == (7, 56)
