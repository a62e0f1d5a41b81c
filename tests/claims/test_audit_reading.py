"""How claimed sets are read: namings, definitions, files of every form, what is refused, and the command."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import echelon as ec
from support.command_line import run
from support.paths import EXAMPLES
from support.published_sets import RX90, RX90_FILE, base, rows

INERTIA = re.compile(r"\b([XYZ])([XYZ])([1-6])\b")
MOMENT = re.compile(r"\bM([XYZ])([1-6])\b")
MASS = re.compile(r"\bM([1-6])\b")


def renamed(text: str, inertia: str, moment: str, mass: str) -> str:
    text = INERTIA.sub(
        lambda f: inertia.format(f[1].lower() + f[2].lower(), f[3]), text
    )
    text = MOMENT.sub(lambda f: moment.format(f[1].lower(), f[2]), text)
    return MASS.sub(lambda f: mass.format(f[1]), text)


NAMED = {
    "echelon": RX90,
    "sympybotics": renamed(RX90, "L_{1}{0}", "l_{1}{0}", "m_{0}"),
    "pinocchio": renamed(RX90, "I{0}{1}", "m{0}{1}", "m{0}"),
}


@pytest.mark.parametrize("naming", NAMED)
def test_published_set_in_every_naming(naming: str, tmp_path: Path) -> None:
    file = tmp_path / "claims.txt"
    file.write_text("# RX90\n" + NAMED[naming])
    found = ec.audit(base(RX90_FILE), file)
    assert found.verdict is ec.Verdict.EQUAL
    assert found.naming == naming
    assert not found.numeric
    assert found.findings[0].claim.name == "ZZR1"
    forced = ec.audit(
        base(RX90_FILE), file, naming="symoro" if naming == "echelon" else naming
    )
    assert forced.equal


def test_bodies_by_name_and_hyphens(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(
        "<robot name='arm'><link name='base'/><link name='up-arm'/><joint name='sh' type='continuous'>"
        "<parent link='base'/><child link='up-arm'/><axis xyz='1 0 0'/></joint></robot>"
    )
    robot = ec.load(file)
    assert (
        ec.audit(robot, ["Ixx_up-arm", "my_up-arm", "mz_up-arm"]).verdict
        is ec.Verdict.EQUAL
    )
    assert (
        ec.audit(robot, ["Ixx_sh", "my_sh - mz_sh", "my_sh + mz_sh"]).verdict
        is ec.Verdict.EQUAL
    )


def test_ignored_and_defined_names() -> None:
    model = base(RX90_FILE)
    claims = [text.replace("RL4", "L") for text in rows()]
    claims[0] += " + IA1"
    found = ec.audit(
        model, [*claims, "FV1", "FS1"], define={"L": "RL4"}, ignore=["IA*", "F?1"]
    )
    assert found.verdict is ec.Verdict.EQUAL
    assert [claim.text for claim in found.ignored] == ["FV1", "FS1"]


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
    (tmp_path / "lines.txt").write_text(
        "".join(f"{name}: {text}  // note\n" for name, text in claims.items())
    )
    for name in ("named.json", "list.json", "lines.txt"):
        assert ec.audit(robot, tmp_path / name).equal
    assert ec.audit(robot, claims).findings[2].claim.name == "beta_2"


@pytest.mark.parametrize(
    ("claim", "message"),
    [
        (
            "XXR2",
            r"'XXR2' is a regrouped parameter, not a standard one: write its expression, such as XX2",
        ),
        (
            "XX9",
            r"'XX9' is neither a standard parameter in the naming echelon nor a symbol of the robot \(nearest: XX",
        ),
        ("ZZ1 + L*M2", "'L' is neither a standard parameter"),
        (
            "ZZ1*M2",
            "the product of ZZ1 and M2 is not linear in the standard parameters",
        ),
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
        "broken.json": ("[", "not well-formed JSON"),
        "number.json": ("[1]", "entry 1: expected an expression as text"),
        "other.json": (
            '{"schema": "x/1"}',
            "schema 'x/1' is not a set of base parameters",
        ),
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
    with pytest.raises(ec.InputError, match="not UTF-8 text"):
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
    assert (data["schema"], data["verdict"], data["equal"]) == (
        "echelon.audit/1",
        "incomplete",
        False,
    )
    assert data["missing"][0]["expression"] == "MX4"
    assert data["missing"][0]["witness"]["change"] == {"MX4": 1.0}
    done = run("audit", RX90_FILE, str(file), "--define", "nonsense")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    report = tmp_path / "report.txt"
    done = run("audit", RX90_FILE, str(file), "-o", str(report))
    assert (done.returncode, done.stdout) == (1, f"wrote {report}\n")
    assert report.read_text().startswith("rx90: INCOMPLETE")
    file.write_text("XX1 + Q7*M2\n")
    done = run("audit", RX90_FILE, str(file))
    assert done.returncode == 2
    assert "line 1: 'Q7' is neither" in done.stderr
    assert done.stderr.count("\n") == 1
