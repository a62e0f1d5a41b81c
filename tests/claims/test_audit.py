"""Sets claimed by others: right ones, and every way of being wrong, with witnesses that are checked."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import echelon as ec
from echelon.base.claims.result import Agreement
from support.float_regressor import float_regressor, random_states
from support.paths import EXAMPLES
from support.published_sets import RX90_FILE, base, rows
from support.robot_files import robot_file

PUMA_FILE = str(EXAMPLES / "puma560.yaml")


def check(found: ec.Audit, model: ec.BaseModel) -> None:
    """Witnesses do what they say, by the regressor in floats."""
    names = list(model.parameters)
    regressor = float_regressor(model.mechanism, *random_states(model.mechanism, 10))
    for finding in found.of(Agreement.WRONG):
        assert finding.witness is not None
        change = np.zeros(len(names))
        for name, value in finding.witness.change.items():
            change[names.index(name)] = value
        assert np.abs(regressor @ change).max() < 1e-9
        assert finding.witness.claimed[finding.number]
    for missing in found.missing:
        change = np.zeros(len(names))
        for name, value in missing.witness.change.items():
            change[names.index(name)] = value
        assert not missing.witness.claimed
        state = [np.array([missing.witness.state[key]]) for key in ("q", "qd", "qdd")]
        outputs = float_regressor(model.mechanism, *state)[0] @ change
        np.testing.assert_allclose(
            outputs, list(missing.witness.outputs.values()), atol=1e-9
        )
        assert np.abs(outputs).max() > 0.01


def test_own_output_in_every_form(tmp_path: Path) -> None:
    model = base(PUMA_FILE)
    assert (
        ec.audit(model, [str(e) for e in model.expressions]).verdict is ec.Verdict.EQUAL
    )
    ec.save_base(model, tmp_path / "set.json")
    assert ec.audit(model, tmp_path / "set.json").verdict is ec.Verdict.EQUAL
    other = ec.base_parameters(model.mechanism, order="tip-to-base", prefer=["M6"])
    assert any("/" in str(e) for e in other.expressions)
    ec.save_base(other, tmp_path / "other.json")
    for claims in (tmp_path / "other.json", [str(e) for e in other.expressions]):
        assert ec.audit(model, claims).verdict is ec.Verdict.EQUAL
        assert ec.audit(other, claims).verdict is ec.Verdict.EQUAL


def test_one_coefficient_altered() -> None:
    model = base(PUMA_FILE)
    claims = [str(e) for e in model.expressions]
    index = next(
        i for i, text in enumerate(claims) if "2·a3·MX4" in text or "·MZ4" in text
    )
    altered = list(claims)
    altered[index] = altered[index].replace("MZ4", "3·MZ4", 1)
    found = ec.audit(model, altered)
    assert found.verdict is ec.Verdict.WRONG
    (wrong,) = found.of(Agreement.WRONG)
    assert (wrong.number, [d.parameter for d in wrong.differences]) == (
        index + 1,
        ["MZ4"],
    )
    assert not found.missing
    check(found, model)


def test_wrong_sign_missing_and_redundant_rows() -> None:
    model, claims = base(RX90_FILE), rows()
    claims[14] = "MY3 - MZ4 + RL4*(M4+M5+M6)"
    dropped = claims.pop(20)
    claims += ["2*ZZ6 - MX6", "M1"]
    found = ec.audit(model, claims)
    assert found.verdict is ec.Verdict.WRONG
    assert [f.number for f in found.of(Agreement.WRONG)] == [15, 37]
    assert [f.number for f in found.findings if f.redundant] == [36]
    assert [str(m.expression) for m in found.missing] == [dropped]
    texts = [str(d) for f in found.of(Agreement.WRONG) for d in f.differences]
    assert texts == [
        "MZ4 has the coefficient -1 instead of 1",
        "the term 1·M1 does not belong here: 1 instead of 0",
    ]
    check(found, model)
    text = str(found)
    assert "witness: add +1 to M1\n" in text
    assert "missing: MX4" in text


def test_verdicts() -> None:
    model, claims = base(RX90_FILE), rows()
    assert ec.audit(model, claims[:-1]).verdict is ec.Verdict.INCOMPLETE
    assert ec.audit(model, [*claims, "MX6 + MY6"]).verdict is ec.Verdict.REDUNDANT
    assert ec.audit(model, [*claims[:-1], "MX6 + MY6"]).verdict is ec.Verdict.EQUAL
    # two rows with the same representative, one of them wrong: the right one is not blamed
    found = ec.audit(model, [*claims, "MX6 + M6"])
    assert found.verdict is ec.Verdict.WRONG
    assert not any(finding.redundant for finding in found.findings)


def test_equal_lengths_do_not_excuse_a_wrong_symbol() -> None:
    """D3 and RL4 of the RX90 are both 0.45 m; the formula is wrong all the same."""
    claims = rows()
    claims[3] = "XZ2 - RL4*MZ3"
    found = ec.audit(base(RX90_FILE), claims)
    assert (
        str(found.of(Agreement.WRONG)[0].differences[0])
        == "MZ3 has the coefficient -RL4 = -0.45 instead of -D3 = -0.45"
    )
    claims[3] = "XZ2 - 0.45*MZ3"
    found = ec.audit(base(RX90_FILE), claims)
    assert (found.verdict, found.numeric) == (ec.Verdict.EQUAL, True)


def test_terms_that_were_dropped() -> None:
    robot = ec.load(EXAMPLES / "double_pendulum.yaml")
    claims = ["ZZ1 + 0.25*M2", "MX1", "MY1", "ZZ2", "MX2", "MY2"]
    length = robot.symbols["l1"].value
    assert length is not None
    found = ec.audit(robot, [f"ZZ1 + {length**2:.4f}*M2", *claims[1:]])
    assert [str(d) for f in found.of(Agreement.WRONG) for d in f.differences] == [
        f"the term l1·M2 is missing: 0 instead of l1 = {length:.6g}"
    ]


def test_measured_inputs_are_part_of_an_example(tmp_path: Path) -> None:
    file = tmp_path / "driven.yaml"
    text = (EXAMPLES / "double_pendulum.yaml").read_text().partition("effects:")[0]
    file.write_text(
        text + "effects: [{type: drive_gain, at: all}, {type: viscous, at: all}]\n"
    )
    model = ec.base_parameters(ec.load(file))
    claims = [str(e) for e in model.expressions]
    assert ec.audit(model, claims).equal
    gain = next(k for k, text in enumerate(claims) if text.startswith("Kt"))
    found = ec.audit(model, claims[:gain] + claims[gain + 1 :])
    (missing,) = found.missing
    assert missing.witness.change == {claims[gain]: 1.0}
    assert any(key.startswith("i[") for key in missing.witness.state)


# -- sets of numeric programs ------------------------------------------------------------------------------------------


def numeric_claims(file: Path, digits: int) -> tuple[list[str], int]:
    """A base set as numeric programs make it: QR of Pinocchio's regressor, coefficients rounded, zeros dropped."""
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(file))
    data = model.createData()
    rng = np.random.default_rng(7)
    stacked = []
    for _ in range(200):
        q = pin.integrate(model, pin.neutral(model), rng.uniform(-2, 2, model.nv))
        v, a = rng.uniform(-2, 2, model.nv), rng.uniform(-2, 2, model.nv)
        stacked.append(pin.computeJointTorqueRegressor(model, data, q, v, a).copy())
    w = np.vstack(stacked)
    kinds = ["m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"]
    names = [f"{kind}{body}" for body in range(1, model.njoints) for kind in kinds]
    seen = [k for k in range(w.shape[1]) if np.linalg.norm(w[:, k]) > 1e-6]
    chosen = independent_columns(w[:, seen])
    base_columns = [seen[k] for k in chosen]
    others = [k for k in seen if k not in base_columns]
    beta = np.linalg.lstsq(w[:, base_columns], w[:, others], rcond=None)[0].round(
        digits
    )
    texts = []
    for i, column in enumerate(base_columns):
        terms = [
            f"{beta[i, j]:+}*{names[other]}"
            for j, other in enumerate(others)
            if beta[i, j]
        ]
        texts.append(" ".join([names[column], *(f"{t[0]} {t[1:]}" for t in terms)]))
    return texts, len(base_columns)


def independent_columns(w: npt.NDArray[np.float64]) -> list[int]:
    r = np.abs(np.diag(np.linalg.qr(w / np.linalg.norm(w, axis=0))[1]))
    return [k for k, size in enumerate(r) if size > 1e-7]


def test_rounded_angles_of_a_file_explain_small_differences() -> None:
    """The xArm's file has 1.5708 for π/2; Pinocchio takes it literally, and its base set shows it."""
    file = robot_file("xarm7")
    claims, count = numeric_claims(file, 6)
    assert count == 43
    intended = ec.audit(ec.load(file), claims)
    assert intended.verdict is ec.Verdict.WRONG
    assert all(
        abs(d.difference or 0) < 1e-5 for f in intended.findings for d in f.differences
    )
    assert "took rounded angles of the robot file as exact" in intended.notes[0]
    assert (
        ec.audit(ec.load(file, snap_tolerance=0), claims).verdict
        is ec.Verdict.EQUAL_TO_PRINTED_DIGITS
    )


@pytest.mark.parametrize(
    ("name", "rank"),
    [pytest.param("ur10_robot", 36, marks=pytest.mark.slow), ("panda", 51)],
)
def test_decimals_of_a_numeric_program(name: str, rank: int) -> None:
    file = robot_file(name)
    claims, count = numeric_claims(file, 6)
    assert count == rank
    model = ec.base_parameters(
        ec.load(file, independent_mimics=True)
    )  # as Pinocchio does
    found = ec.audit(model, claims)
    assert found.naming == "pinocchio"
    assert found.equal, str(found)
    rounded, _ = numeric_claims(file, 3)
    found = ec.audit(model, rounded)
    assert found.verdict is ec.Verdict.EQUAL_TO_PRINTED_DIGITS, str(found)
    largest = max(f.largest_difference for f in found.findings)
    assert 0 < largest < 0.5001e-3
    assert ec.audit(model, rounded[:-1]).verdict is ec.Verdict.INCOMPLETE
    altered = list(rounded)
    index = next(
        k for k, text in enumerate(rounded) if re.search(r" \+ 0\.\d+\*m\d", text)
    )
    altered[index] = re.sub(
        r" \+ 0\.\d+\*(m\d)", r" + 0.987*\1", altered[index], count=1
    )
    found = ec.audit(model, altered)
    assert [f.number for f in found.of(Agreement.WRONG)] == [index + 1]
    check(found, model)
