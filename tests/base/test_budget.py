"""Always an answer: closed forms while the budget lasts, then numbers with a bound, checked and saved like the rest."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pinocchio as pin
import pytest
from click.testing import CliRunner

from echelon import base_parameters, load, load_base, save_base, verify
from echelon.algebra.exact.expressions import PI, parse
from echelon.algebra.exact.polynomial import is_trigonometric, symbol_of
from echelon.algebra.exact.rational import RationalFunction
from echelon.base.derive import base_matrix
from echelon.base.expression import collect
from echelon.base.model import BaseModel
from echelon.base.structure import find_structure
from echelon.cli.commands import app
from echelon.robot.joint import Symbol
from echelon.robot.stated import all_symbols
from echelon.shared.errors import CertificateError, ClosedFormError, InputError
from support import textbook_arms as arms
from support.float_regressor import FloatArray
from support.paths import EXAMPLES
from support.robot_files import robot_file
from support.selection import slow_unless

AXES = ("0 0 1", "1 2 3", "2 -1 1", "3 1 -2")


def odd_arm(
    joints: int,
    first: str = "0 0 0",
    prismatic: tuple[int, ...] = (),
    mimic: tuple[int, ...] = (),
    axis: str = AXES[0],
) -> str:
    """URDF of an arm with axes in general directions and generic origins; ``first`` is the first joint's rpy."""
    rng = np.random.default_rng(3)
    parts = ['<robot name="odd"><link name="l0"/>']
    for i in range(1, joints + 1):
        kind = "prismatic" if i in prismatic else "revolute"
        xyz, rpy = (
            " ".join(f"{x:.2f}" for x in rng.uniform(*limits, 3))
            for limits in ((0.1, 0.5), (0.2, 1.4))
        )
        coupled = f'<mimic joint="j{i - 1}" multiplier="0.75"/>' if i in mimic else ""
        parts.append(
            f'<link name="l{i}"/><joint name="j{i}" type="{kind}"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<origin xyz="{xyz}" rpy="{first if i == 1 else rpy}"/><axis xyz="{axis if i == 1 else AXES[i - 1]}"/>'
            f'<limit lower="-1" upper="1" effort="1" velocity="1"/>{coupled}</joint>'
        )
    return "\n".join([*parts, "</robot>"])


def read(text: str, folder: Path) -> BaseModel:
    return base_parameters(load(written(text, folder)))


def written(text: str, folder: Path) -> Path:
    file = folder / "robot.urdf"
    file.write_text(text)
    return file


def pinocchio_regressor(file: Path, samples: int) -> FloatArray:
    """W of a URDF by Pinocchio, in our parameter order."""
    model = pin.buildModelFromUrdf(str(file))
    data, rng = model.createData(), np.random.default_rng(4)
    columns = [
        10 * block + k
        for block in range(model.njoints - 1)
        for k in (4, 5, 7, 6, 8, 9, 1, 2, 3, 0)
    ]
    rows = [
        pin.computeJointTorqueRegressor(model, data, *rng.normal(size=(3, model.nv)))
        for _ in range(samples)
    ]
    return np.vstack(rows)[:, columns]


ROBOTS = {
    "two odd axes": odd_arm(3),
    "oblique to gravity": odd_arm(3, "0.3 0.4 0.5"),
    "all axes odd": odd_arm(3, "0.3 0.4 0.5", axis="2 1 3"),
    "prismatic and oblique": odd_arm(4, "0.3 0.4 0.5", prismatic=(1, 3)),
    "prismatic first": odd_arm(4, "0.3 0.4 0.5", prismatic=(1, 2)),
}


@pytest.mark.parametrize("budget", slow_unless([1], [0, 1]))
@pytest.mark.parametrize("name", slow_unless(["oblique to gravity"], ROBOTS))
def test_pinocchio_agrees(name: str, budget: float, tmp_path: Path) -> None:
    """W = W̄ B with W from another program, and the rank that its singular values show."""
    file = written(ROBOTS[name], tmp_path)
    base = base_parameters(load(file), budget=budget)
    observation = pinocchio_regressor(file, 60)
    sizes = np.linalg.svd(observation, compute_uv=False)
    assert sizes[base.rank - 1] > 1e-7 > 1e-11 > sizes[base.rank]
    matrix = base.B_float()
    np.testing.assert_allclose(
        observation[:, base.matrix.pivots] @ matrix, observation, atol=1e-9
    )


def test_the_arm_of_many_symbols_has_closed_forms(tmp_path: Path) -> None:
    base = read(odd_arm(3), tmp_path)
    assert base.matrix.numbers is None
    assert len(base.matrix.symbols) > 10


@pytest.mark.slow
@pytest.mark.parametrize("mimic", [(2,), (3,)])
def test_couplings(mimic: tuple[int, ...], tmp_path: Path) -> None:
    """Numbers and closed forms agree where there are both."""
    robot = load(written(odd_arm(4, "0.3 0.4 0.5", mimic=mimic), tmp_path))
    closed, numbers = base_parameters(robot), base_parameters(robot, budget=0)
    assert numbers.matrix.numbers is not None
    np.testing.assert_allclose(
        numbers.B_float(), closed.B_float(), rtol=1e-12, atol=1e-12
    )


@pytest.mark.slow
@pytest.mark.parametrize("budget", [0, 1])
def test_romeo_with_coupled_fingers_finishes(budget: float) -> None:
    """Numbers are the closed forms evaluated, up to rounding."""
    robot = load(robot_file("romeo"))
    structure, rng = (
        find_structure(robot, np.random.default_rng(0)),
        np.random.default_rng(1),
    )
    order = tuple(range(structure.parameters))
    closed, found = (
        base_matrix(robot, structure, order, rng, b, str) for b in (1, budget)
    )
    assert closed.numbers is None
    values = {s: symbol.value or 0.0 for s, symbol in robot.symbols.items()}
    np.testing.assert_allclose(
        found.floats(values), closed.floats(values), rtol=1e-12, atol=1e-12
    )


# -- numbers ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "order", slow_unless(["tip-to-base"], ["base-to-tip", "tip-to-base"])
)
@pytest.mark.parametrize(
    "robot",
    slow_unless(
        ["panda.yaml", "tx40.yaml"], ["panda.yaml", "tx40.yaml", "loops/four_bar.yaml"]
    ),
)
def test_exact_numbers_are_the_closed_forms_evaluated(robot: str, order: str) -> None:
    mechanism = load(EXAMPLES / robot)
    closed = base_parameters(mechanism, order=order)
    numbers = base_parameters(mechanism, order=order, budget=0)
    assert numbers.matrix.numbers is not None
    assert numbers.matrix.numbers.radius == 0
    assert not numbers.matrix.symbols
    assert numbers.pivots == closed.pivots
    assert numbers.classification == closed.classification
    assert numbers.B_exact == closed.B_exact


def test_numbers_with_square_roots() -> None:
    robot = arms.slanted()
    names = enumerate(sorted(all_symbols(robot)))
    stated = replace(
        robot, symbols={s: Symbol(s, (k + 2) / 10, f"{(k + 2) / 10}") for k, s in names}
    )
    numbers, closed = base_parameters(stated, budget=0), base_parameters(stated)
    assert numbers.matrix.numbers is not None
    assert numbers.matrix.numbers.radius == 0
    assert (
        (numbers.B_exact - closed.B_exact)
        .applyfunc(lambda x: x.simplify())
        .is_zero_matrix
    )


def test_numbers_have_their_bound(tmp_path: Path) -> None:
    """Against the closed forms, evaluated with 60 digits by mpmath."""
    robot = load(written(odd_arm(3), tmp_path))
    closed, numbers = base_parameters(robot), base_parameters(robot, budget=0)
    assert numbers.matrix.numbers is not None
    assert 0 < numbers.matrix.numbers.radius < 1e-30
    with mpmath.workdps(60):
        pi = {PI: mpmath.pi()}
        values = {
            s: mpmath.atan(mpmath.sqrt(mpmath_number(symbol.tangent_squared)))
            if symbol.tangent_squared
            else parse(symbol.exact or repr(symbol.value)).evaluate(pi, mpmath_number)
            for s, symbol in robot.symbols.items()
        }
        assert any(symbol.tangent_squared for symbol in robot.symbols.values())
        known = {g: mpmath_generator(g, values) for g in closed.matrix.generators}
        for mine, theirs in zip(numbers.matrix.rows, closed.matrix.rows, strict=True):
            assert mine.keys() == theirs.keys()
            for column, coefficient in theirs.items():
                difference = coefficient.evaluate(known, mpmath_number) - mine[
                    column
                ].evaluate({}, mpmath_number)
                assert abs(difference) <= numbers.matrix.numbers.radius


def mpmath_generator(generator: str, values: dict[str, Any]) -> Any:
    value = values[symbol_of(generator)]
    if not is_trigonometric(generator):
        return value
    return mpmath.cos(value) if generator.startswith("cos") else mpmath.sin(value)


def mpmath_number(x: Any) -> Any:
    fraction = Fraction(x)
    return mpmath.mpf(fraction.numerator) / fraction.denominator


def test_numbers_hold_at_the_stated_values_only() -> None:
    base = base_parameters(load(EXAMPLES / "panda.yaml"), budget=0)
    assert base.B_float({"d3": 0.316}) == pytest.approx(base.B_float())
    with pytest.raises(InputError, match=r"numbers at d3 = 0\.316"):
        base.B_float({"d3": 0.4})


def test_a_symbol_without_a_value_needs_a_closed_form() -> None:
    with pytest.raises(
        ClosedFormError,
        match=r"'.*' has no value: give it a value, or give a larger budget",
    ):
        base_parameters(arms.inclined(), budget=0)


def test_a_negative_budget_is_refused() -> None:
    with pytest.raises(InputError, match="budget"):
        base_parameters(arms.inclined(), budget=-1)


# -- saved sets, certificates and text --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", slow_unless(["panda"], ["panda", "odd"]))
def test_numbers_are_saved_and_verified(name: str, tmp_path: Path) -> None:
    robot = load(
        EXAMPLES / "panda.yaml" if name == "panda" else written(odd_arm(3), tmp_path)
    )
    base, file = base_parameters(robot, budget=0), tmp_path / "base.json"
    save_base(base, file)
    again = load_base(file)
    assert again.matrix == base.matrix
    assert verify(again).numbers == len(
        base.matrix.numbers.columns if base.matrix.numbers else ()
    )
    assert "at the stated values only" in str(again.certificate)

    data = json.loads(file.read_text())
    term = next(
        t
        for row in data["base"]
        for t in row["terms"]
        if t["parameter"] in data["numbers"]["parameters"]
    )
    changed = Fraction(term["coefficient"]) + Fraction(1, 10**20)
    term["coefficient"] = f"{changed.numerator}/{changed.denominator}"
    data["echelon"] = "another version"  # which may word expressions in another way
    file.write_text(json.dumps(data))
    with pytest.raises(CertificateError, match="wrong"):
        verify(file)


@pytest.mark.slow
def test_a_large_bound_does_not_hide_a_wrong_number(tmp_path: Path) -> None:
    base, file = (
        base_parameters(load(written(odd_arm(3), tmp_path)), budget=0),
        tmp_path / "base.json",
    )
    save_base(base, file)
    data = json.loads(file.read_text())
    data["numbers"]["radius"] = 1e-6
    file.write_text(json.dumps(data))
    with pytest.raises(CertificateError, match="prove nothing"):
        verify(file)


def test_text_says_what_is_a_number_and_how_to_ask_for_more() -> None:
    result = CliRunner().invoke(
        app, ["derive", str(EXAMPLES / "double_pendulum.yaml"), "--budget", "0"]
    )
    assert result.exit_code == 0
    assert (
        "numbers: the coefficients of YY2" in result.stdout
        or "numbers: the coefficients of M2" in result.stdout
    )
    assert "larger --budget" in result.stdout
    assert (
        "in place of closed forms"
        not in CliRunner()
        .invoke(app, ["derive", str(EXAMPLES / "double_pendulum.yaml")])
        .stdout
    )


@pytest.mark.slow
def test_numeric_gives_numbers_where_sines_are_not_exact(tmp_path: Path) -> None:
    file = written(odd_arm(3), tmp_path)
    result = CliRunner().invoke(app, ["derive", str(file), "--numeric", "--json"])
    assert result.exit_code == 0, result.output
    record = json.loads(result.stdout)
    terms = [term for row in record["base"] for term in row["terms"]]
    assert all(Fraction(term["coefficient"]) for term in terms)
    assert 0 < record["numbers"]["radius"] < 1e-30
    assert record["rank"] == base_parameters(load(file)).rank


def test_small_numbers_in_latex() -> None:
    expression = collect(
        "ZZ1", "kg·m²", [("M2", RationalFunction(Fraction(-1, 3 * 10**9)))], ["M2"]
    )
    assert str(expression) == "ZZ1 − 3.33333333e-10·M2"
    assert (
        expression.latex
        == r"\mathit{ZZ}_{1} - 3.33333333\cdot 10^{-10}\,\mathit{M}_{2}"
    )


def test_progress_names_the_phases() -> None:
    phases: list[str] = []
    base_parameters(load(EXAMPLES / "panda.yaml"), progress=phases.append)
    assert phases[0] == "structure"
    assert "closed forms: 0 of 18 columns" in phases
    assert phases[-1] == "certificate"
