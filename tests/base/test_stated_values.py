"""The robot's own numbers decide: special values of symbols, the relations that matter, exact decimal angles."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from fractions import Fraction
from math import cos, exp, sin
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.algebra.exact.expressions import Angle
from echelon.algebra.exact.field import PrimeField, residues_at
from echelon.algebra.exact.polynomial import float_generators
from echelon.base.reading_report import report_reading
from echelon.base.saved.saved import from_json, to_json
from echelon.formats.snapping import ReadingOptions
from echelon.robot.mechanism import Mechanism
from echelon.robot.stated import StatedValues, stated_values, unit_of
from support.descriptions import read_description
from support.paths import ROOT


def read(text: str, **options: object) -> Mechanism:
    return read_description(
        f"echelon: 1\n{text}".encode(), "robot.yaml", ReadingOptions(**options)
    )  # type: ignore[arg-type]


def offset_arm(a2: str = "0", d2: str = "0") -> Mechanism:
    """A first axis along gravity and a second one parallel to it, at a distance a2."""
    return read(
        f"""
symbols: {{a2: {a2}, d2: {d2}, a3: 0.4}}
modified_dh:
  - {{joint: revolute}}
  - {{joint: revolute, a: a2}}
  - {{joint: revolute, alpha: pi/2, a: a3, d: d2}}
"""
    )


PANDA = ROOT / "examples/panda.yaml"

PARALLELOGRAM = """
symbols: {l0: 1.0, l1: 0.5, l2: 1.0, l3: 0.5}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: coupler, parent: crank, joint: {type: revolute, axis: z, origin: {xyz: [l1, 0, 0]}}}
  - {name: rocker, joint: {type: revolute, axis: z, origin: {xyz: [l0, 0, 0]}}}
loops: [{joint: revolute, connects: [coupler, rocker], at: {xyz: [l2, 0, 0]}, on_second: {xyz: [l3, 0, 0]}}]
independent: [crank]
assembly: {crank: 1, coupler: -1, rocker: 1}
"""

PARALLEL_BY_SUM = """
symbols: {alpha: 0.3, beta: 0.4, gamma: GAMMA}
gravity: [0, -9.81, 0]
modified_dh:
  - {joint: revolute}
  - {joint: fixed, alpha: alpha, a: 0.2}
  - {joint: fixed, alpha: beta}
  - {joint: revolute, alpha: gamma}
"""


# -- rank, relations, classification -----------------------------------------------------------------------------------


def test_the_stated_zero_decides_and_is_named() -> None:
    base = ec.base_parameters(offset_arm())
    assert base.rank == 9
    assert base.special is not None
    assert (base.special.generic_rank, base.special.relations) == (11, ("a2 = 0",))
    assert "11 in general; 9 for this robot, because a2 = 0" in str(base)
    # closed forms keep what does not matter
    assert set(base.matrix.symbols) == {"a3", "d2"}
    assert base.certificate.at_values


def test_an_ordinary_value_changes_nothing() -> None:
    base = ec.base_parameters(offset_arm(a2="0.1"))
    assert (base.rank, base.special) == (11, None)
    assert "a2" in base.matrix.symbols


def test_general_symbols_on_request_tell_both_counts() -> None:
    base = ec.base_parameters(offset_arm(), generic=True)
    assert base.rank == 11
    assert base.special is not None
    assert base.special.rank == 9
    assert ec.base_structure(offset_arm(), generic=True).rank == 11
    assert ec.base_structure(offset_arm()).rank == 9


@pytest.mark.slow
def test_a_parallelogram_by_equal_values() -> None:
    base = ec.base_parameters(read(PARALLELOGRAM))
    assert base.rank == 3
    assert base.special is not None
    assert base.special.relations == ("l2 = l0", "l3 = l1")
    # the classical result: crank and rocker turn alike, the coupler only moves along
    assert [str(e) for e in base.expressions] == [
        "ZZ1 + l1²·M2 + ZZ3",
        "MX1 + l1·M2 + MX3",
        "MY1 + MY3",
    ]


@pytest.mark.parametrize(
    ("gamma", "rank", "relation"),
    [("-0.7", 6, "gamma = −alpha − beta"), ("-0.71", 10, None)],
)
def test_angles_that_cancel(gamma: str, rank: int, relation: str | None) -> None:
    base = ec.base_parameters(read(PARALLEL_BY_SUM.replace("GAMMA", gamma)))
    assert base.rank == rank
    assert (base.special and base.special.relations) == (
        None if relation is None else (relation,)
    )


@pytest.mark.parametrize(("ratio", "rank"), [("-1", 3), ("-2", 5), ("1", 5)])
def test_a_ratio_may_be_special(ratio: str, rank: int) -> None:
    """Two parallel joints in the plane with q2 = n q1: the second body only moves along for n = −1."""
    robot = read(
        f"""
symbols: {{n: {ratio}, l: 0.3}}
gravity: [0, -9.81, 0]
couplings: [{{j2: n*j1}}]
modified_dh: [{{joint: revolute}}, {{joint: revolute, a: l}}]
"""
    )
    base = ec.base_parameters(robot)
    assert base.rank == rank
    assert (base.special is None) == (ratio != "-1")


def test_classes_are_those_at_the_stated_values() -> None:
    text = """
symbols: {l2: 0.3, l3: 0.3, e: EXCESS}
gravity: [0, -9.81, 0]
modified_dh: [{joint: revolute}, {joint: revolute, a: l2 - l3 + e}, {joint: revolute, a: l3}]
"""
    ordinary = ec.base_parameters(read(text.replace("EXCESS", "0.1")))
    special = ec.base_parameters(read(text.replace("EXCESS", "0")))
    assert ordinary.rank == special.rank == 9
    assert ordinary.classification["M2"] is not special.classification["M2"]
    assert special.classification["M2"].value == "unidentifiable"


def test_numbers_throughout(tmp_path: Path) -> None:
    text = """
echelon: 1
symbols: {a2: 0.1, a3: 0.4, alpha: pi/2}
modified_dh: [{joint: revolute}, {joint: revolute, alpha: alpha, a: a2}, {joint: revolute, a: a3}]
"""
    file = tmp_path / "robot.yaml"
    file.write_text(text)
    base = ec.base_parameters(ec.load(file, symbolic=False))
    assert base.matrix.symbols == ()
    np.testing.assert_allclose(
        base.B_float(), ec.base_parameters(ec.load(file)).B_float(), rtol=1e-15
    )


def test_symbols_of_one_magnitude_may_be_kept_apart(tmp_path: Path) -> None:
    links = "".join(f'<link name="l{k}"/>' for k in range(4))
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k - 1}"/><child link="l{k}"/>'
        f'<origin xyz="0.2 0 0" rpy="{1.5707963 if k == 2 else 0} 0 0"/><axis xyz="0 0 1"/></joint>'
        for k in (1, 2, 3)
    )
    file = tmp_path / "robot.urdf"
    file.write_text(f'<robot name="r">{links}{joints}</robot>')
    assert len(ec.base_parameters(ec.load(file)).matrix.symbols) == 1
    apart = ec.base_parameters(ec.load(file, separate_symbols=True))
    assert len(apart.matrix.symbols) == 2
    assert apart.rank == ec.base_parameters(ec.load(file)).rank


# -- what uses the set -------------------------------------------------------------------------------------------------


def test_saved_sets_keep_the_reason_and_verify(tmp_path: Path) -> None:
    base = ec.base_parameters(offset_arm())
    file = tmp_path / "base.json"
    ec.save_base(base, file)
    again = ec.load_base(file)
    assert again.special == base.special
    assert to_json(again) == to_json(base)
    assert ec.verify(file).at_values


def test_a_saved_set_is_not_minimal_for_another_value(tmp_path: Path) -> None:
    """The eleven of the general arm are too many once the file says a2 = 0."""
    file = tmp_path / "base.json"
    ec.save_base(ec.base_parameters(offset_arm(a2="0.1")), file)
    data = json.loads(file.read_text())
    data["model"]["symbols"]["a2"] = "0"
    for row in data["base"]:
        for term in row["terms"]:
            term["value"] = None if "a2" in term["coefficient"] else term["value"]
    file.write_text(json.dumps(data))
    with pytest.raises(ec.EchelonError):
        ec.verify(file)


def test_sensors_see_the_robot_at_hand() -> None:
    joints = ("j1", "j2", "j3")
    assert ec.sensor_report(offset_arm(), size=3).ranks[joints] == 9
    assert ec.sensor_report(offset_arm(a2="0.1"), size=3).ranks[joints] == 11


def test_reduced_regressor_of_the_robot_at_hand_has_full_rank() -> None:
    rng = np.random.default_rng(1)
    base = ec.base_parameters(offset_arm())
    regressor = base.regressor(*(rng.uniform(-2, 2, (60, 3)) for _ in range(3)))
    singular = np.linalg.svd(regressor.reshape(-1, base.rank), compute_uv=False)
    assert singular[-1] > 1e-3 * singular[0]


# -- exact angles ------------------------------------------------------------------------------------------------------

decimals = st.fractions(min_value=-4, max_value=4, max_denominator=10**6)


@given(st.lists(decimals, min_size=1, max_size=6))
def test_all_decimals_are_multiples_of_one_unit(values: list[Fraction]) -> None:
    unit = unit_of(values)
    assert unit > 0
    assert all((v / unit).denominator == 1 for v in values)


@given(decimals, decimals, st.integers(-3, 3))
def test_points_of_angles_add_up_as_the_decimals_do(
    a: Fraction, b: Fraction, k: int
) -> None:
    """The point of a + k·b is the product of the points of a and k·b, modulo any prime."""
    names = ("a", "b", "c")
    total = a + k * b
    values = StatedValues(
        {}, {n: Angle(radians=v) for n, v in zip(names, (a, b, total), strict=True)}, {}
    )
    rng = np.random.default_rng(3)
    field = PrimeField.random(rng)
    points = {n: field.circle(t) for n, t in values.draw(names, field, rng).items()}
    expected = field.add_angles(points["a"], field.multiply_angle(points["b"], k))
    assert [int(x[0]) for x in expected] == [int(x[0]) for x in points["c"]]


def test_values_are_stated_exactly() -> None:
    values = stated_values(read(PARALLEL_BY_SUM.replace("GAMMA", "pi/4 - 0.1")))
    assert values.angles["gamma"] == Angle(Fraction(1, 4), radians=Fraction(-1, 10))
    assert values.multiples["alpha"] == (0, 3, 0)
    assert values.multiples["gamma"] == (3, -1, 0)


@pytest.mark.parametrize("count", [1, -2, 8, 9, 33, -40, 10**6])
def test_multiples_of_any_size(count: int) -> None:
    angle = Angle(parts=(("x", count),))
    value = 0.7
    expected = cos(count * value)
    found = angle.cos().evaluate(
        float_generators(angle.cos().generators(), {"x": value}), float
    )
    assert found == pytest.approx(expected, abs=1e-9)
    rng = np.random.default_rng(1)
    field = PrimeField.random(rng)
    point = field.circle(field.draw(rng, (1,)))
    assert int(field.multiply_angle(point, count)[0][0]) == int(
        field.multiply_angle(field.multiply_angle(point, -count), -1)[0][0]
    )


def test_large_multiples_of_a_symbol_are_one_circle_point() -> None:
    robot = read(
        """
symbols: {alpha: 0.3, beta: -12}
gravity: [0, -9.81, 0]
modified_dh: [{joint: revolute}, {joint: fixed, alpha: 40*alpha, a: 0.2}, {joint: revolute, alpha: beta}]
"""
    )
    assert ec.base_structure(robot).rank == 6  # 40 · 0.3 − 12 = 0: parallel axes
    assert ec.base_structure(robot, generic=True).rank == 10


def test_a_declared_decimal_near_a_right_angle_is_one_and_said_so() -> None:
    robot = read(
        "symbols: {alpha: 1.5708}\nmodified_dh: [{joint: revolute}, {joint: revolute, alpha: alpha}]"
    )
    assert robot.reading is not None
    assert [str(s) for s in robot.reading.snaps] == [
        "symbols.alpha: 1.5708 read as 90°"
    ]
    literal = read(
        "symbols: {alpha: 1.5708}\nmodified_dh: [{joint: revolute}, {joint: revolute, alpha: alpha}]",
        snap_tolerance=0,
    )
    assert literal.symbols["alpha"].exact == "1.5708"


# -- the net underneath ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("error", [-2, -1, 1, 2])
def test_float_ranks_doubt_a_wrong_count_and_no_right_one(error: int) -> None:
    robot = ec.load(PANDA)
    assert report_reading(robot, 43, np.random.default_rng(1)).doubt == ""
    assert (
        f"does not confirm {43 + error}: rank 43"
        in report_reading(robot, 43 + error, np.random.default_rng(1)).doubt
    )


def test_float_ranks_of_neighbours_stand_for_those_of_a_large_robot(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = ec.load(PANDA)
    base = ec.base_parameters(robot)
    monkeypatch.setattr("echelon.base.reading_report.MOST_COLUMNS", 40)
    assert (
        report_reading(robot, 43, np.random.default_rng(1), matrix=base.matrix).doubt
        == ""
    )
    wrong = replace(base.matrix, rows=base.matrix.rows[:20])
    assert (
        "for the parameters"
        in report_reading(robot, 43, np.random.default_rng(1), matrix=wrong).doubt
    )


def test_half_turns_have_residues(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "symbols: {alpha: pi, l: 0.3}\nmodified_dh: [{joint: revolute}, {joint: revolute, alpha: alpha, a: l}]"
    base = ec.base_parameters(read(text), generic=True)
    assert "alpha" in base.matrix.symbols
    field, rng = PrimeField.of(2**31 - 105), np.random.default_rng(1)
    drawn = stated_values(read(text)).draw(["alpha"], field, rng)
    assert residues_at(["cos(alpha)", "sin(alpha)"], drawn, field) == {
        "cos(alpha)": field.p - 1,
        "sin(alpha)": 0,
    }
    monkeypatch.setattr("echelon.base.reading_report.MOST_COLUMNS", 12)
    stated = ec.base_parameters(read(text))
    assert (
        report_reading(
            read(text), stated.rank, np.random.default_rng(1), matrix=stated.matrix
        ).doubt
        == ""
    )


def test_a_count_that_is_not_compared_is_said() -> None:
    robot = ec.load(PANDA)
    assert "not compared" in report_reading(robot, 1001, np.random.default_rng(1)).doubt


SCREWS = """echelon: 1
name: screws
gravity: [0, 0, 0]
symbols: {{p: {one}, r: {two}}}
bodies:
  - {{name: nut, joint: {{type: helical, axis: z, pitch: p}}}}
  - {{name: second, parent: nut, joint: {{type: helical, axis: z, pitch: r}}}}
"""


@pytest.mark.parametrize(
    ("one", "two", "rank"),
    [
        ("0.01/(2*pi)", "0.01/(2*pi)", 2),  # two screws that travel equally are one
        ("0.01/(2*pi)", "0.005/pi", 2),
        ("0.01/(2*pi)", "-0.01/(2*pi)", 3),
        ("0.01/(2*pi)", "0.02/(2*pi)", 3),
        ("0.01/(2*pi)", "0.00159154943", 3),  # a decimal is not the quotient
        ("0.001*pi", "0.001*pi^2/pi", 2),
    ],
)
def test_lengths_with_pi_have_their_relations(one: str, two: str, rank: int) -> None:
    base = ec.base_parameters(
        read_description(
            SCREWS.format(one=one, two=two).encode(), "s.yaml", ReadingOptions()
        )
    )
    assert base.rank == rank
    pitch = eval(one, {"pi": math.pi})
    masses = base.parameters.index("M1")
    assert base.B_float()[0, masses] == pytest.approx(pitch**2, rel=1e-12)
    assert float(base.B_exact[0, masses]) == pytest.approx(pitch**2, rel=1e-12)
    assert ec.verify(from_json(to_json(base))).rank == rank


def test_a_length_with_pi_is_written_as_a_symbol() -> None:
    text = SCREWS.format(one="1", two="1").replace("pitch: p}", "pitch: 0.01/(2*pi)}")
    with pytest.raises(
        ec.InputError, match=r"write a symbol here, and its value in 'symbols'"
    ):
        read_description(text.encode(), "s.yaml", ReadingOptions())


PENDULUM = "bodies: [{name: arm, joint: {type: revolute, axis: y, name: j}}]\n"


def with_effects(symbols: str, *terms: str) -> Mechanism:
    effects = [
        f"{{parameter: P{k}, unit: N·m, acts: [{{at: j, term: '{t}'}}]}}"
        for k, t in enumerate(terms)
    ]
    return read(f"symbols: {{{symbols}}}\n{PENDULUM}effects: [{', '.join(effects)}]")


@pytest.mark.parametrize(("alpha", "sign"), [("0", "+"), ("pi", "−")])
def test_angles_in_effects_have_their_stated_values(alpha: str, sign: str) -> None:
    """sin(alpha) is zero, and cos(q - alpha) is cos(q) or its opposite."""
    robot = with_effects(
        f"alpha: {alpha}", "sin(alpha)*qd", "qd*cos(q - alpha)", "qd*cos(q)"
    )
    base = ec.base_parameters(robot)
    assert [str(e) for e in base.expressions][-1] == f"P1 {sign} P2"
    assert base.rank == 4
    assert ec.verify(from_json(to_json(base))).at_values


def test_functions_of_constants_are_numbers_where_these_have_values() -> None:
    """A saved set has no names for them; it is read back and verified."""
    base = ec.base_parameters(
        with_effects("k: 2, alpha: 0.3", "exp(k)*qd", "qd", "sin(alpha)*q", "q")
    )
    np.testing.assert_allclose(
        base.B_float()[-2:, -4:], [[1, exp(-2), 0, 0], [0, 0, 1, 1 / sin(0.3)]]
    )
    assert ec.verify(from_json(to_json(base))).numbers == 1


def test_sums_of_fractions_of_pi_are_not_passed_over() -> None:
    """Axes 1 and 3 are antiparallel, which no random residue for pi/7 shows: refused with what to write."""
    arm = "modified_dh: [{joint: revolute}, {joint: prismatic, alpha: a, a: l}, {joint: revolute, alpha: %s, a: l}]"
    with pytest.raises(ec.CertificateError, match="pi - beta"):
        ec.base_parameters(
            read("symbols: {a: 3*pi/7, b: 4*pi/7, l: 0.3}\n" + arm % "b")
        )
    with pytest.warns(ec.DoubtWarning, match="pi - beta"):
        ec.base_structure(read("symbols: {a: 3*pi/7, b: 4*pi/7, l: 0.3}\n" + arm % "b"))
    assert (
        ec.base_parameters(read("symbols: {a: 3*pi/7, l: 0.3}\n" + arm % "pi - a")).rank
        == 7
    )
    assert (
        ec.base_parameters(
            read("symbols: {a: pi/7, b: 2*pi/7, l: 0.3}\n" + arm % "b")
        ).rank
        == 11
    )
