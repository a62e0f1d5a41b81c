"""Sets claimed by others: right ones in every naming, and every way of being wrong, with witnesses that are checked."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import echelon as ec
from echelon.claims.findings import Agreement
from oracles import float_regressor, random_states
from robots import has_pinocchio, robot_file
from test_cli import run

EXAMPLES = Path(__file__).parents[1] / "examples"
RX90_FILE, PUMA_FILE = str(EXAMPLES / "rx90.yaml"), str(EXAMPLES / "puma560.yaml")

RX90 = """
ZZR1 = ZZ1 + YY2 + YY3 + D3^2*(M3+M4+M5+M6)
XXR2 = XX2 - YY2 - D3^2*(M3+M4+M5+M6)
XY2
XZR2 = XZ2 - D3*MZ3
YZ2
ZZR2 = ZZ2 + D3^2*(M3+M4+M5+M6)
MXR2 = MX2 + D3*(M3+M4+M5+M6)
MY2
XXR3 = XX3 - YY3 + YY4 + 2*RL4*MZ4 + RL4^2*(M4+M5+M6)
XY3
XZ3
YZ3
ZZR3 = ZZ3 + YY4 + 2*RL4*MZ4 + RL4^2*(M4+M5+M6)
MX3
MYR3 = MY3 + MZ4 + RL4*(M4+M5+M6)
XXR4 = XX4 - YY4 + YY5
XY4
XZ4
YZ4
ZZR4 = ZZ4 + YY5
MX4
MYR4 = MY4 - MZ5
XXR5 = XX5 - YY5 + YY6
XY5
XZ5
YZ5
ZZR5 = ZZ5 + YY6
MX5
MYR5 = MY5 + MZ6
XXR6 = XX6 - YY6
XY6
XZ6
YZ6
ZZ6
MX6
MY6
"""
"""Khalil & Dombre, "Modeling, Identification and Control of Robots" (2002), table 9.3, masses spelled out."""

INERTIA = re.compile(r"\b([XYZ])([XYZ])([1-6])\b")
MOMENT = re.compile(r"\bM([XYZ])([1-6])\b")
MASS = re.compile(r"\bM([1-6])\b")


def renamed(text: str, inertia: str, moment: str, mass: str) -> str:
    text = INERTIA.sub(lambda f: inertia.format(f[1].lower() + f[2].lower(), f[3]), text)
    text = MOMENT.sub(lambda f: moment.format(f[1].lower(), f[2]), text)
    return MASS.sub(lambda f: mass.format(f[1]), text)


NAMED = {
    "echelon": RX90,
    "sympybotics": renamed(RX90, "L_{1}{0}", "l_{1}{0}", "m_{0}"),
    "pinocchio": renamed(RX90, "I{0}{1}", "m{0}{1}", "m{0}"),
}


@cache
def base(file: str) -> ec.BaseModel:
    return ec.base_parameters(ec.load(file))


def rows(text: str = RX90) -> list[str]:
    return [line.partition("=")[2].strip() or line.strip() for line in text.strip().splitlines()]


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
        np.testing.assert_allclose(outputs, list(missing.witness.outputs.values()), atol=1e-9)
        assert np.abs(outputs).max() > 0.01


@pytest.mark.parametrize("naming", NAMED)
def test_published_set_in_every_naming(naming: str, tmp_path: Path) -> None:
    file = tmp_path / "claims.txt"
    file.write_text("# RX90\n" + NAMED[naming])
    found = ec.audit(base(RX90_FILE), file)
    assert found.verdict is ec.Verdict.EQUAL
    assert found.naming == naming
    assert not found.numeric
    assert found.findings[0].claim.name == "ZZR1"
    forced = ec.audit(base(RX90_FILE), file, naming="symoro" if naming == "echelon" else naming)
    assert forced.equal


def test_own_output_in_every_form(tmp_path: Path) -> None:
    model = base(PUMA_FILE)
    assert ec.audit(model, [str(e) for e in model.expressions]).verdict is ec.Verdict.EQUAL
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
    index = next(i for i, text in enumerate(claims) if "2·a3·MX4" in text or "·MZ4" in text)
    altered = list(claims)
    altered[index] = altered[index].replace("MZ4", "3·MZ4", 1)
    found = ec.audit(model, altered)
    assert found.verdict is ec.Verdict.WRONG
    (wrong,) = found.of(Agreement.WRONG)
    assert (wrong.number, [d.parameter for d in wrong.differences]) == (index + 1, ["MZ4"])
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
    assert texts == ["MZ4 has the coefficient -1 instead of 1", "the term 1·M1 does not belong here"]
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
    assert str(found.of(Agreement.WRONG)[0].differences[0]) == "MZ3 has the coefficient -RL4 instead of -D3"
    claims[3] = "XZ2 - 0.45*MZ3"
    found = ec.audit(base(RX90_FILE), claims)
    assert (found.verdict, found.numeric) == (ec.Verdict.EQUAL, True)


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
    beta = np.linalg.lstsq(w[:, base_columns], w[:, others], rcond=None)[0].round(digits)
    texts = []
    for i, column in enumerate(base_columns):
        terms = [f"{beta[i, j]:+}*{names[other]}" for j, other in enumerate(others) if beta[i, j]]
        texts.append(" ".join([names[column], *(f"{t[0]} {t[1:]}" for t in terms)]))
    return texts, len(base_columns)


def independent_columns(w: npt.NDArray[np.float64]) -> list[int]:
    r = np.abs(np.diag(np.linalg.qr(w / np.linalg.norm(w, axis=0))[1]))
    return [k for k, size in enumerate(r) if size > 1e-7]


def test_rounded_angles_of_a_file_explain_small_differences() -> None:
    """The xArm's file has 1.5708 for π/2; Pinocchio takes it literally, and its base set shows it."""
    file = robot_file("xarm7")
    if not has_pinocchio():
        pytest.skip("Pinocchio is not installed")
    claims, count = numeric_claims(file, 6)
    assert count == 43
    intended = ec.audit(ec.load(file), claims)
    assert intended.verdict is ec.Verdict.WRONG
    assert all(abs(d.difference or 0) < 1e-5 for f in intended.findings for d in f.differences)
    assert "rounded angles were read as exact" in intended.notes[0]
    assert ec.audit(ec.load(file, tolerance=0), claims).verdict is ec.Verdict.EQUAL_TO_PRINTED_DIGITS


@pytest.mark.parametrize(("name", "rank"), [("ur10_robot", 36), ("panda", 51)])
def test_decimals_of_a_numeric_program(name: str, rank: int) -> None:
    if not has_pinocchio():
        pytest.skip("Pinocchio is not installed")
    file = robot_file(name)
    claims, count = numeric_claims(file, 6)
    assert count == rank
    model = ec.base_parameters(ec.load(file, independent_mimics=True))  # as Pinocchio does
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
    index = next(k for k, text in enumerate(rounded) if re.search(r" \+ 0\.\d+\*m\d", text))
    altered[index] = re.sub(r" \+ 0\.\d+\*(m\d)", r" + 0.987*\1", altered[index], count=1)
    found = ec.audit(model, altered)
    assert [f.number for f in found.of(Agreement.WRONG)] == [index + 1]
    check(found, model)


def test_terms_that_were_dropped() -> None:
    robot = ec.load(EXAMPLES / "double_pendulum.yaml")
    claims = ["ZZ1 + 0.25*M2", "MX1", "MY1", "ZZ2", "MX2", "MY2"]
    length = robot.symbols["l1"].value
    assert length is not None
    found = ec.audit(robot, [f"ZZ1 + {length**2:.4f}*M2", *claims[1:]])
    assert [str(d) for f in found.of(Agreement.WRONG) for d in f.differences] == ["the term l1·M2 is missing"]


def test_bodies_by_name_and_hyphens(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(
        "<robot name='arm'><link name='base'/><link name='up-arm'/><joint name='sh' type='continuous'>"
        "<parent link='base'/><child link='up-arm'/><axis xyz='1 0 0'/></joint></robot>"
    )
    robot = ec.load(file)
    assert ec.audit(robot, ["Ixx_up-arm", "my_up-arm", "mz_up-arm"]).verdict is ec.Verdict.EQUAL
    assert ec.audit(robot, ["Ixx_sh", "my_sh - mz_sh", "my_sh + mz_sh"]).verdict is ec.Verdict.EQUAL


def test_ignored_and_defined_names() -> None:
    model = base(RX90_FILE)
    claims = [text.replace("RL4", "L") for text in rows()]
    claims[0] += " + IA1"
    found = ec.audit(model, [*claims, "FV1", "FS1"], define={"L": "RL4"}, ignore=["IA*", "F?1"])
    assert found.verdict is ec.Verdict.EQUAL
    assert [claim.text for claim in found.ignored] == ["FV1", "FS1"]


def test_measured_inputs_are_part_of_an_example(tmp_path: Path) -> None:
    file = tmp_path / "driven.yaml"
    text = (EXAMPLES / "double_pendulum.yaml").read_text()
    file.write_text(text + "effects: [{type: drive_gain, at: all}, {type: viscous, at: all}]\n")
    model = ec.base_parameters(ec.load(file))
    claims = [str(e) for e in model.expressions]
    assert ec.audit(model, claims).equal
    gain = next(k for k, text in enumerate(claims) if text.startswith("Kt"))
    found = ec.audit(model, claims[:gain] + claims[gain + 1 :])
    (missing,) = found.missing
    assert missing.witness.change == {claims[gain]: 1.0}
    assert any(key.startswith("i[") for key in missing.witness.state)


CSV = """base parameter;value;std
# comment
ZZ1 + l1^2*M2;1.25;0.1
MX1 + l1*M2;0.3;0.2

MY1;;
ZZ2;1;1
"""


def test_files(tmp_path: Path) -> None:
    robot = ec.load(EXAMPLES / "double_pendulum.yaml")
    table = tmp_path / "set.csv"
    table.write_text(CSV + "MX2;1;\nMY2;1;\n")
    found = ec.audit(robot, table)
    assert found.verdict is ec.Verdict.EQUAL
    assert found.findings[0].claim.columns == {"value": "1.25", "std": "0.1"}
    assert found.findings[1].claim.where == "line 4"
    claims = {f"beta_{k}": f.claim.text for k, f in enumerate(found.findings)}
    (tmp_path / "named.json").write_text(json.dumps(claims))
    (tmp_path / "list.json").write_text(json.dumps(list(claims.values())))
    (tmp_path / "lines.txt").write_text("".join(f"{name}: {text}  // note\n" for name, text in claims.items()))
    for name in ("named.json", "list.json", "lines.txt"):
        assert ec.audit(robot, tmp_path / name).equal
    assert ec.audit(robot, claims).findings[2].claim.name == "beta_2"


@pytest.mark.parametrize(
    ("claim", "message"),
    [
        ("XXR2", r"'XXR2' is a regrouped parameter, not a standard one: write its expression, such as XX2"),
        (
            "XX9",
            r"'XX9' is neither a standard parameter in the naming of echelon nor a symbol of the robot \(nearest: XX",
        ),
        ("ZZ1 + L*M2", "'L' is neither a standard parameter"),
        ("ZZ1*M2", "the product of ZZ1 and M2 is not linear in the standard parameters"),
        ("ZZ1^2", "'ZZ1' holds a standard parameter, which must be linear"),
        ("ZZ1 + 3", "the term 3 stands without a standard parameter"),
        ("ZZ1 - ZZ1", "'ZZ1 - ZZ1' is zero"),
        ("ZZ1 / 0", "divides by zero"),
        ("ZZ1 +", "is not an expression such as"),
        ("__import__('os')", "is not"),
        ("ZZ1 + l1**99*M2", "only powers 0 to 32"),
        ("ZZ1 + (1).real*M2", "is not allowed in an expression"),
    ],
)
def test_claims_that_cannot_be_read(claim: str, message: str) -> None:
    robot = base(str(EXAMPLES / "double_pendulum.yaml"))
    with pytest.raises(ec.InputError, match=message) as caught:
        ec.audit(robot, ["MY1", claim])
    assert "entry 2" in str(caught.value)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    robot = base(str(EXAMPLES / "double_pendulum.yaml"))
    contents = {
        "empty.txt": ("# nothing\n", "holds no base parameters"),
        "broken.json": ("[", "not JSON"),
        "number.json": ("[1]", "entry 1: expected an expression as text"),
        "other.json": ('{"schema": "x/1"}', "schema 'x/1' is not a set of base parameters"),
        "half.json": ('{"schema": "echelon.base-model/1"}', "not a document of schema"),
        "scalar.json": ("3", "expected a list of expressions"),
    }
    for name, (content, message) in contents.items():
        (tmp_path / name).write_text(content)
        with pytest.raises(ec.InputError, match=message) as caught:
            ec.audit(robot, tmp_path / name)
        assert name in str(caught.value)
    with pytest.raises(ec.InputError, match="no such file"):
        ec.audit(robot, tmp_path / "absent.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ec.InputError, match="not a text file in UTF-8"):
        ec.audit(robot, tmp_path / "binary.csv")
    with pytest.raises(ec.InputError, match="unknown naming 'x'"):
        ec.audit(robot, ["MY1"], naming="x")
    with pytest.raises(ec.InputError, match="every row is ignored"):
        ec.audit(robot, ["Fv1"], ignore=["Fv*"])


def test_command(tmp_path: Path) -> None:
    file = tmp_path / "claims.txt"
    file.write_text(RX90)
    done = run("audit", RX90_FILE, str(file))
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("rx90: EQUAL: ")
    file.write_text(RX90.replace("MX4\n", ""))
    done = run("audit", RX90_FILE, str(file), "--json")
    assert done.returncode == 1
    data = json.loads(done.stdout)
    assert (data["schema"], data["verdict"], data["equal"]) == ("echelon.audit/1", "incomplete", False)
    assert data["missing"][0]["expression"] == "MX4"
    assert data["missing"][0]["witness"]["change"] == {"MX4": 1.0}
    done = run("audit", RX90_FILE, str(file), "--define", "nonsense")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    done = run("audit", RX90_FILE, str(file), "-o", str(tmp_path / "report.txt"))
    assert (done.returncode, done.stdout) == (1, "")
    assert (tmp_path / "report.txt").read_text().startswith("rx90: INCOMPLETE")
    file.write_text("XX1 + Q7*M2\n")
    done = run("audit", RX90_FILE, str(file))
    assert done.returncode == 2
    assert "line 1: 'Q7' is neither" in done.stderr
    assert done.stderr.count("\n") == 1
