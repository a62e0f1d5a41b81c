"""The YAML description: what it means, the round trip, and the one clear error for every mistake."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml

import echelon as ec
from echelon.base.saved.schema import BaseModelRecord, LinearBaseRecord
from echelon.calibration import calibration_schema
from echelon.comparison.result import comparison_schema
from echelon.excite.files.trajectory_file import trajectory_schema
from echelon.formats.robot_file import RobotFile
from echelon.formats.schema.robot_schema import json_schema
from echelon.formats.snapping import ReadingOptions
from echelon.formats.writers.description_writer import write_description
from echelon.identification.saved.schema import IdentifiedRecord
from echelon.robot.mechanism import Mechanism
from echelon.shared.record_schemas import file_schema
from support import textbook_arms as arms
from support.descriptions import read_description
from support.float_regressor import float_regressor, random_states
from support.paths import ROOT
from support.selection import one_in

EXAMPLES = {
    "cart_pole": 4,
    "coupled_arm": 63,
    "double_pendulum": 6,
    "floating_tree": 39,
    "furuta": 8,
    "gripper_coupled": 15,
    "panda": 43,
    "puma560": 36,
    "rx90": 36,
    "scara": 8,
    "stanford": 33,
    "tx40": 61,
    "ur10": 36,
}


def read(text: str, name: str = "robot.yaml", **options: Any) -> Mechanism:
    return RobotFile.of(text.encode(), name).mechanism(ReadingOptions(**options))


# -- meaning ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples(name: str) -> None:
    mechanism = ec.load(ROOT / f"examples/{name}.yaml")
    assert ec.base_structure(mechanism).rank == EXAMPLES[name]
    jsonschema.Draft202012Validator(json_schema()).validate(
        yaml.safe_load((ROOT / f"examples/{name}.yaml").read_text())
    )


def test_no_example_is_forgotten() -> None:
    assert {file.stem for file in (ROOT / "examples").glob("*.yaml")} == set(EXAMPLES)


def test_modified_dh_is_what_textbooks_mean() -> None:
    from_file, from_code = ec.load(ROOT / "examples/rx90.yaml"), arms.rx90()
    assert (
        ec.base_parameters(from_file).matrix.rows
        == ec.base_parameters(from_code).matrix.rows
    )


def test_standard_and_modified_dh_of_the_same_arm_see_the_same() -> None:
    """A standard frame j sits where the modified frame j + 1 mounts, so the ranks agree, with and without gravity."""
    standard = """
echelon: 1
symbols: {a1: 0.1, a2: 0.2, d1: 0.3, d2: 0.4}
gravity: GRAVITY
standard_dh:
  - {joint: revolute, d: d1, a: a1, alpha: pi/2}
  - {joint: revolute, d: d2, a: a2, alpha: -pi/2}
  - {joint: revolute}
"""
    modified = """
echelon: 1
symbols: {a1: 0.1, a2: 0.2, d1: 0.3, d2: 0.4}
gravity: GRAVITY
modified_dh:
  - {joint: revolute, d: d1}
  - {joint: revolute, d: d2, a: a1, alpha: pi/2}
  - {joint: revolute, a: a2, alpha: -pi/2}
"""
    for gravity in ("none", "generic", "[0, 0, -9.81]", "[0, -9.81, 0]"):
        ranks = {
            ec.base_structure(read(t.replace("GRAVITY", gravity))).rank
            for t in (standard, modified)
        }
        assert len(ranks) == 1
    # body 3 has the same frame in both, since its row ends without constants: equal efforts of its parameters
    states = random_states(read(standard.replace("GRAVITY", "[0, 0, -9.81]")), 3)
    x = [
        float_regressor(read(t.replace("GRAVITY", "[0, 0, -9.81]")), *states)
        for t in (standard, modified)
    ]
    np.testing.assert_allclose(x[0][:, :, 20:], x[1][:, :, 20:], atol=1e-12)


ONE = "echelon: 1\nbodies:\n  - {name: a, joint: {type: revolute, axis: z}}\n"


def test_bodies_may_come_in_any_order() -> None:
    text = (
        "echelon: 1\nbodies:\n  - {name: b, parent: a, joint: {type: prismatic, axis: x}}\n"
        "  - {name: a, joint: {type: revolute, axis: z}}"
    )
    assert [b.name for b in read(text).bodies] == ["a", "b"]


def test_decimal_angles_are_snapped_and_named() -> None:
    rows = "echelon: 1\nmodified_dh:\n  - {joint: revolute}\n  - {joint: revolute, alpha: 1.5708, a: 0.3}\n"
    mechanism = read(rows + "  - {joint: revolute, alpha: 0.3, a: 0.2}\n")
    assert mechanism.reading is not None
    assert [snap.literal for snap in mechanism.reading.snaps] == ["1.5708"]
    assert {s.exact for s in mechanism.symbols.values()} == {"0.3"}
    assert ec.base_structure(mechanism).rank == 15


@pytest.mark.parametrize("name", ["E", "I", "S", "N", "Q", "lambda1", "beta", "γ"])
def test_symbols_may_be_named_like_functions_of_other_programs(name: str) -> None:
    text = (
        f"echelon: 1\nsymbols: {{{name}: 0.5}}\nmodified_dh:\n  - {{joint: revolute}}\n"
    )
    base = ec.base_parameters(
        read(text + f"  - {{joint: revolute, alpha: pi/2, a: '{name}'}}\n")
    )
    assert base.matrix.symbols == (name,)
    assert str(base.B_exact).count("I") == 0
    assert name in str(base)


def test_couplings_with_offsets_and_symbols() -> None:
    text = """
echelon: 1
symbols: {n: 3, l: 0.2}
couplings: [{j3: n*j1 - 2*j2 + pi/2}]
modified_dh:
  - {joint: revolute}
  - {joint: revolute, alpha: pi/2, a: l}
  - {joint: revolute, alpha: pi/2, a: l}
"""
    mechanism = read(text)
    assert mechanism.velocities == ("j1", "j2")
    assert {n: str(r) for n, r in mechanism.couplings[0].terms} == {
        "j1": "n",
        "j2": "-2",
    }
    moved = read(text.replace("theta", "t").replace(" + pi/2", ""))
    q, qd, qdd = random_states(mechanism, 2)
    free = read(text.replace("couplings: [{j3: n*j1 - 2*j2 + pi/2}]", ""))
    t = np.array([[1, 0], [0, 1], [3, -2]])
    full = float_regressor(free, q @ t.T + [0, 0, np.pi / 2], qd @ t.T, qdd @ t.T)
    np.testing.assert_allclose(
        float_regressor(mechanism, q, qd, qdd),
        np.einsum("oi,kon->kin", t, full),
        atol=1e-11,
    )
    assert moved.bodies != mechanism.bodies


# -- round trip ------------------------------------------------------------------------------------------------

ROBOTS = [
    arms.rx90, arms.panda, arms.helical, arms.universal, arms.cylindrical, arms.prismatic, arms.coupled, arms.rack,
    arms.massless, arms.branched, arms.floating_pair, arms.spherical, arms.stanford, arms.cart_pole,
]  # fmt: skip


@pytest.mark.parametrize("robot", one_in(2, ROBOTS))
def test_round_trip(robot: Callable[[], Mechanism]) -> None:
    mechanism = robot()
    text = json.dumps(write_description(mechanism))
    again = read_description(text, "robot.json", ReadingOptions(keep_fixed_links=True))
    assert (again.bodies, again.couplings, again.gravity) == (
        mechanism.bodies, mechanism.couplings, mechanism.gravity,
    )  # fmt: skip
    assert json.dumps(write_description(again)) == text
    jsonschema.Draft202012Validator(json_schema()).validate(json.loads(text))


@pytest.mark.parametrize(
    "file",
    [
        "robot",
        "base_model",
        "linear_base",
        "identified",
        "trajectory",
        "comparison",
        "calibration",
    ],
)
def test_published_schemas_are_up_to_date(file: str) -> None:
    which = "description" if file == "robot" else file.replace("_", "-")
    expected = {
        "robot": json_schema,
        "base_model": lambda: file_schema(BaseModelRecord),
        "linear_base": lambda: file_schema(LinearBaseRecord),
        "identified": lambda: file_schema(IdentifiedRecord),
        "trajectory": trajectory_schema,
        "comparison": comparison_schema,
        "calibration": calibration_schema,
    }[file]()
    path = ROOT / f"schemas/{file}.schema.json"
    if json.loads(path.read_text()) != expected:  # the difference would say nothing
        command = f"echelon schema {which} > schemas/{file}.schema.json"
        pytest.fail(f"{path} is not up to date: run  {command}", pytrace=False)


def test_a_saved_model_follows_its_schema(tmp_path: Path) -> None:
    ec.save_base(ec.base_parameters(arms.double_pendulum()), tmp_path / "base.json")
    jsonschema.Draft202012Validator(file_schema(BaseModelRecord)).validate(
        json.loads((tmp_path / "base.json").read_text())
    )


# -- mistakes --------------------------------------------------------------------------------------------------

HEAD = "echelon: 1\nsymbols: {l: 0.3}\n"
DH = HEAD + "modified_dh:\n  - {joint: revolute}\n"


def row(text: str) -> str:
    return f"{DH}  - {{{text}}}\n"


def bodies(*entries: str) -> str:
    return HEAD + "bodies:\n" + "".join(f"  - {{{entry}}}\n" for entry in entries)


TURN = "joint: {type: revolute, axis: z}"
MISTAKES = {
    "syntax": ("echelon: 1\nname: [", "line 2"),
    "empty": ("", "robot.yaml"),
    "list": ("- 1", "mapping"),
    "version missing": ("name: x", "'echelon' is missing"),
    "version unknown": (DH.replace("echelon: 1", "echelon: 7"), "echelon"),
    "duplicate key": (HEAD + "symbols: {l: 1}\n", "symbols"),
    "no form": (HEAD, "exactly one of modified_dh"),
    "two forms": (DH + f"bodies:\n  - {{name: a, {TURN}}}\n", "exactly one"),
    "empty table": (HEAD + "modified_dh: []\n", "at least one row"),
    "typo in a key": (row("joint: revolute, alhpa: pi"), "alpha"),
    "typo at the top": (DH + "gravitty: none\n", "gravity"),
    "typo in a type": (row("joint: revolut"), "revolute"),
    "unknown symbol": (row("joint: revolute, a: m"), "'m'"),
    "not an expression": (
        row("joint: revolute, alpha: 'pi/('"),
        "modified_dh[1].alpha",
    ),
    "not a number": (row("joint: revolute, a: hello world"), "modified_dh[1].a"),
    "nan": (row("joint: revolute, a: .nan"), "modified_dh[1].a"),
    "infinite": (row("joint: revolute, a: .inf"), "modified_dh[1].a"),
    "division by zero": (row("joint: revolute, a: l/0"), "division"),
    "length as angle": (row("joint: revolute, alpha: l*l"), "modified_dh[1].alpha"),
    "reserved symbol": (DH.replace("{l: 0.3}", "{l: 0.3, pi: 3}"), "pi"),
    "keyword symbol": (DH.replace("{l: 0.3}", "{l: 0.3, lambda: 3}"), "lambda"),
    "tangent of another angle": (
        DH.replace("0.3", "{approximate: 0.4, tangent_squared: 1/4}"),
        "symbols.l.tangent_squared: it must be that of the angle stated as approximate",
    ),
    "tangent of no angle": (
        DH.replace("0.3", "{approximate: 0.785, tangent_squared: 0}"),
        "0 is not that of 0.785 rad",
    ),
    "tangent of a negative angle": (
        DH.replace("0.3", "{approximate: -0.4636476, tangent_squared: 1/4}"),
        "between 0 and pi/2, and 1/4 is not that of -0.4636476 rad",
    ),
    "tangent without an angle": (
        DH.replace("0.3", "{tangent_squared: 1/4}"),
        "stated as approximate",
    ),
    "symbol value": (DH.replace("0.3", "[1]"), "symbols.l"),
    "unknown antecedent": (row("joint: revolute, parent: 9"), "9"),
    "unknown parent": (bodies(f"name: a, parent: z, {TURN}"), "'z'"),
    "cycle": (
        bodies(f"name: a, parent: b, {TURN}", f"name: b, parent: a, {TURN}"),
        "circle: a -> b -> a",
    ),
    "name twice": (bodies(f"name: a, {TURN}", f"name: a, parent: a, {TURN}"), "a"),
    "zero axis": (bodies("name: a, joint: {type: revolute, axis: [0, 0, 0]}"), "axis"),
    "no axis": (bodies("name: a, joint: {type: revolute}"), "axis"),
    "unknown joint": (bodies("name: a, joint: {type: screw}"), "helical"),
    "no pitch": (bodies("name: a, joint: {type: helical, axis: z}"), "pitch"),
    "parallel axes": (
        bodies("name: a, joint: {type: universal, axis: z, axis2: z}"),
        "perpendicular",
    ),
    "coupling unknown": (DH + "couplings: [{j9: j1}]\n", "j9"),
    "coupling itself": (row("joint: revolute") + "couplings: [{j2: 2*j2}]\n", "j2"),
    "coupling nonlinear": (
        row("joint: revolute") + "couplings: [{j2: cos(j1)}]\n",
        "j2",
    ),
    "gravity": (DH + "gravity: [0, 0]\n", "gravity"),
    "gravity word": (DH + "gravity: sideways\n", "gravity"),
    "inertial": (row("joint: revolute, inertial: {mass: 1}"), "inertial"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_mistakes(case: str) -> None:
    text, hint = MISTAKES[case]
    with pytest.raises(ec.InputError) as caught:
        read(text)
    message = str(caught.value)
    assert hint in message
    assert message.startswith("robot.yaml")
    assert "\n" not in message


def test_alias_bombs_are_refused() -> None:
    lines = ["a0: &a0 [x]"] + [
        f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)
    ]
    with pytest.raises(ec.InputError):
        read("echelon: 1\n" + "\n".join(lines))


@pytest.mark.parametrize(
    "data", [b"\xff\xfe\x00", b"\x00\x01", "echelon: 1\nname: \u0007".encode()]
)
def test_binary_files_are_refused(data: bytes) -> None:
    with pytest.raises(ec.InputError, match=r"robot\.yaml"):
        RobotFile.of(data, "robot.yaml").mechanism(ReadingOptions())


def test_a_robot_without_bodies_is_a_valid_empty_answer() -> None:
    assert ec.base_parameters(read("echelon: 1\nbodies: []")).rank == 0
