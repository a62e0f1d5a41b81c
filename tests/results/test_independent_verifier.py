"""The verifier of one file, which needs nothing but Python; both verifiers refuse forged sets."""

from __future__ import annotations

import ast
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given

import echelon as ec
from echelon.algebra.exact.expressions import parse
from echelon.algebra.exact.polynomial import float_generators
from echelon.algebra.exact.rational import RationalFunction
from echelon.base.saved import echelon_verify
from echelon.base.saved.echelon_verify import judge
from echelon.base.saved.saved import from_json, to_dict, to_json
from echelon.formats.snapping import ReadingOptions
from echelon.robot.mechanism import Mechanism
from support import textbook_arms as arms
from support.descriptions import read_description
from support.forgeries import FORGERIES, Forged, forged
from support.paths import EXAMPLES, ROOT
from support.random_mechanisms import mechanisms
from support.selection import examples, one_in

VALID, REFUTED, UNREADABLE, NOT_COVERED = range(4)


def derived(text: str, tmp_path: Path) -> str:
    """The saved set of a description."""
    (tmp_path / "robot.yaml").write_text(text, encoding="utf-8")
    return to_json(ec.base_parameters(ec.load(tmp_path / "robot.yaml")))


# -- what it is -------------------------------------------------------------------------------------------------------


def test_it_imports_nothing_but_the_standard_library() -> None:
    tree = ast.parse(Path(echelon_verify.__file__).read_text(encoding="utf-8"))
    imports = [
        node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    modules = {
        n
        for i in imports
        for n in (
            [i.module] if isinstance(i, ast.ImportFrom) else [a.name for a in i.names]
        )
    }
    assert all(
        module and module.split(".")[0] in sys.stdlib_module_names for module in modules
    )
    assert not any(isinstance(i, ast.ImportFrom) and i.level for i in imports)


def test_the_copy_beside_the_source_is_the_one_that_is_shipped() -> None:
    assert (ROOT / "verifier" / "echelon_verify.py").read_bytes() == Path(
        echelon_verify.__file__
    ).read_bytes()


def test_it_runs_alone(tmp_path: Path) -> None:
    shutil.copy(ROOT / "verifier" / "echelon_verify.py", tmp_path / "check.py")
    (tmp_path / "set.json").write_text(
        to_json(ec.base_parameters(arms.double_pendulum())), encoding="utf-8"
    )
    for target, code in (("set.json", VALID), ("check.py", UNREADABLE)):
        command = [sys.executable, "-I", "-S", "check.py", target]
        done = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == code, done.stderr
        assert not done.stderr


# -- what it accepts --------------------------------------------------------------------------------------------------


LONG = ("coupled_arm", "lwr4", "tx40")  # more than a second each


@pytest.mark.parametrize(
    "file",
    [
        pytest.param(file, marks=pytest.mark.slow if file.stem in LONG else ())
        for file in sorted((ROOT / "examples").glob("*.yaml"))
    ],
    ids=lambda file: file.stem,
)
def test_examples(file: Path) -> None:
    code, sentence = judge(to_json(ec.base_parameters(ec.load(file))))
    assert code == VALID, sentence


@pytest.mark.parametrize(
    "robot",
    one_in(
        2, [*arms.KINDS, arms.spherical, arms.branched, arms.free_body, arms.cartesian]
    ),
)
@pytest.mark.parametrize("order", ["base-to-tip", "tip-to-base"])
def test_every_joint_type(robot: Callable[[], Mechanism], order: str) -> None:
    code, sentence = judge(to_json(ec.base_parameters(robot(), order=order)))
    assert code == VALID, sentence


@examples(8)
@given(mechanism=mechanisms())
def test_generated_robots(mechanism: Mechanism) -> None:
    code, sentence = judge(to_json(ec.base_parameters(mechanism)))
    assert code == VALID, sentence


ARM = """
echelon: 1
name: arm
symbols: {a: 0.3, b: 0.2, alpha: %s, beta: %s, n: 3}
bodies:
  - {name: one, joint: {type: revolute, axis: y}}
  - {name: two, parent: one, joint: {type: revolute, axis: y, origin: {xyz: [a, 0, b], rpy: [alpha, 0, 0]}}}
  - {name: three, parent: two, joint: {type: revolute, axis: y, origin: {xyz: [a, 0, 0], rpy: [beta, 0, 0]}}}
"""
ANGLES = [
    *(
        ("0.3", "-0.3"),
        ("0.3", "0.4"),
        ("pi/6", "pi/12"),
        ("7*pi/12", "0.7"),
        ("null", "pi/4"),
    ),
    *(("pi/7", "-pi/7"), ("pi/180", "0.35*pi + 0.2"), ("pi", "pi/5")),
]
SETUPS = {
    "friction": "effects: [{type: viscous, at: all}, {type: asymmetric_coulomb, at: all}, {type: offset, at: one}]",
    "springs": "effects: [{type: spring, at: all}, {type: rotor_inertia, at: two, side: joint}]",
    "gains": "effects: [{type: drive_gain, at: [one, two]}]",
    "terms": "effects: [{parameter: P, unit: N·m, acts: [{at: one, term: 'abs(qd)*qd[two]*a + 2*q^2'}]}]",
    "drives": "actuators: {m1: 30*one + 3*two, m2: one - two}\neffects: [{type: coulomb, at: all}]",
    "some drives": "actuators: {m1: 30*one, m2: one - two}\noutputs: [{actuator: m2}, {actuator: three}]",
    "sensor": "outputs: [{wrench: three, frame: {xyz: [0.1, 0, a]}}, {joint: one}]",
    "sensor before": "outputs: [{wrench: two, fixed_to: parent, components: [tz, fx]}, {wrench: base}]",
    "sums of rates": "effects: [{parameter: P, unit: N·m, acts: [{at: one, term: 'abs(2*qd + qd[two])'}]}]",
    "ratios of symbols": "actuators: {m1: n*one + two, m2: one - two}\neffects: [{type: viscous, at: all}]",
    "sum": "outputs: [{name: s, unit: N·m, sum: [{joint: one}, {joint: two, weight: -1/2}]}, {joint: three}]",
    "mimic": "couplings: [{three: 2*one - two/3}]",
    "rotor": "rotors: [{name: r, on: two, drives: 50*three, axis: x, frame: {rpy: [pi/2, 0, 0]}}]",
    "no gravity": "gravity: none",
    "any gravity": "gravity: generic",
    "some torques": "outputs: [{wrench: two, components: [ty]}, {wrench: three, components: [tx], frame: {xyz: [0, b, a]}}]",
    "load cell": "outputs: [{name: pin, unit: N, sum: [{wrench: three, component: fx, frame: {xyz: [0.1, 0, a]}, weight: a},"
    "{wrench: three, component: tz, weight: -2}, {joint: one}]}, {wrench: two, components: [ty]}]",
    "zeros": "outputs: [{wrench: base, name: s, components: [fz, tx]}, {joint: one}]\n"
    "effects: [{type: offset, at: s}, {parameter: P, unit: N, acts: [{at: s.fz, term: 'qd[two]'}]}]",
}


@pytest.mark.parametrize(("alpha", "beta"), ANGLES)
def test_stated_angles(alpha: str, beta: str, tmp_path: Path) -> None:
    code, sentence = judge(derived(ARM % (alpha, beta), tmp_path))
    assert code == VALID, sentence


@pytest.mark.parametrize("case", one_in(2, SETUPS))
def test_setups(case: str, tmp_path: Path) -> None:
    code, sentence = judge(derived(ARM % ("0", "pi/2") + SETUPS[case], tmp_path))
    assert code == VALID, sentence


# -- for whom a set holds ---------------------------------------------------------------------------------------------


@cache
def described(text: str, *, generic: bool = False) -> str:
    """The saved set of a description, for its stated values or for general ones."""
    return to_json(
        ec.base_parameters(
            read_description(text, "described", ReadingOptions()), generic=generic
        )
    )


def general(text: str) -> dict[str, Any]:
    """The saved set for general values of the symbols."""
    found: dict[str, Any] = json.loads(described(text, generic=True))
    return found


PARALLEL = """
echelon: 1
name: parallel axes
symbols: {a2: 0, d2: 0, a3: 0.4}
modified_dh: [{joint: revolute}, {joint: revolute, a: a2}, {joint: revolute, alpha: pi/2, a: a3, d: d2}]
"""
# 9 is that of docs/stated-values.md; arms in a plane have 1 base parameter of the first joint and 3 of each other one
TWISTED = """
echelon: 1
name: twisted
symbols: {a: 0.3, b: 0.2, alpha: pi, beta: %s, gamma: pi}
gravity: [0, 0, -9.81]
bodies:
  - {name: one, joint: {type: revolute, axis: z}}
  - {name: two, parent: one, joint: {type: revolute, axis: z, origin: {xyz: [a, 0, b], rpy: [alpha, 0, 0]}}}
  - {name: three, parent: two, joint: {type: revolute, axis: z, origin: {xyz: [a, 0, b], rpy: [beta, 0, 0]}}}
  - {name: four, parent: three, joint: {type: revolute, axis: z, origin: {xyz: [a, 0, b], rpy: [gamma, 0, 0]}}}
"""
BENT = """
echelon: 1
name: bent
symbols: {a: 0.3, alpha: pi/5, beta: 4*pi/5}
bodies:
  - {name: one, joint: {type: revolute, axis: z}}
  - {name: bent, parent: one, joint: {type: fixed, origin: {xyz: [a, 0, 0], rpy: [alpha, 0, 0]}}}
  - {name: two, parent: bent, joint: {type: revolute, axis: z, origin: {rpy: [beta, 0, 0]}}}
"""
OTHERS = """
echelon: 1
name: as many
symbols: {a: 0.3, c: 0.2, bend: pi/2, rest: 0.3}
bodies:
  - {name: one, joint: {type: revolute, axis: z}}
  - {name: two, parent: one, joint: {type: prismatic, axis: x, origin: {xyz: [a, 0, c], rpy: [bend, 0, 0]}}}
  - {name: three, parent: two, joint: {type: revolute, axis: y, origin: {xyz: [0, 0, c], rpy: [rest, 0, 0]}}}
"""
SPECIAL = {
    "a length": (PARALLEL, 9),
    "all parallel": (TWISTED % "pi", 10),
    "three parallel": (TWISTED % "pi/7", 18),
}


@pytest.mark.parametrize("case", SPECIAL)
def test_it_says_for_whom_a_set_holds(case: str) -> None:
    text, rank = SPECIAL[case]
    own = json.loads(described(text))
    assert own["rank"] == rank
    assert judge(json.dumps(own))[1].startswith(
        f"valid: {rank} base parameters of {len(own['parameters'])} at the stated"
    )
    data = general(text)
    code, sentence = judge(json.dumps(data))
    assert code == VALID
    assert f"for general values of the symbols ({rank} at the stated ones)" in sentence


@pytest.mark.parametrize("case", SPECIAL)
def test_a_general_set_says_that_fewer_are_independent_at_the_stated_values(
    case: str,
) -> None:
    text, rank = SPECIAL[case]
    data = general(text)
    others = [
        {"rank": rank + 1},
        {"generic_rank": data["rank"] + 1},
        {"rank": data["rank"]},
    ]
    for special in (None, *({**data["special"], **other} for other in others)):
        code, sentence = judge(json.dumps({**data, "special": special}))
        assert code == REFUTED
        assert (
            f"at the stated values {rank} of {data['rank']} are independent" in sentence
        )


@pytest.mark.parametrize("case", SPECIAL)
def test_a_general_set_is_not_minimal_at_special_values(case: str) -> None:
    text, rank = SPECIAL[case]
    data = general(text)
    code, sentence = judge(json.dumps({**data, "generic": False, "special": None}))
    assert code == REFUTED
    assert f"of its {data['rank']} rows only {rank} are independent" in sentence


def test_a_general_set_does_not_make_up_special_values() -> None:
    data = general(PARALLEL.replace("a2: 0", "a2: 0.3"))
    assert data["special"] is None
    assert judge(json.dumps(data))[0] == VALID
    special = {"rank": 9, "generic_rank": data["rank"], "relations": ["a2 = 0"]}
    assert judge(json.dumps({**data, "special": special}))[0] == REFUTED


def test_other_representatives_at_the_stated_values_are_named() -> None:
    """As many are independent at the stated values, but others."""
    data = general(OTHERS)
    assert data["special"]["rank"] == data["rank"]
    assert judge(json.dumps(data))[0] == VALID
    assert judge(json.dumps({**data, "special": None}))[0] == REFUTED


def test_five_fifths_of_pi_are_pi() -> None:
    """No joint is between the two bends, so the axes of the joints are antiparallel: 1 + 3 instead of 1 + 7."""
    data = general(BENT)
    assert (data["rank"], judge(json.dumps({**data, "generic": False}))) == (
        8,
        (REFUTED, "NOT valid: it is not minimal: of its 8 rows only 4 are independent"),
    )


# -- speed ------------------------------------------------------------------------------------------------------------


def test_a_dozen_states_show_the_rank(monkeypatch: pytest.MonkeyPatch) -> None:
    text, states, rows = saved("panda"), [], echelon_verify.Robot.rows

    def counted(robot: Any) -> Any:
        states.append(robot)
        return rows(robot)

    monkeypatch.setattr(echelon_verify.Robot, "rows", counted)
    code, sentence = judge(text)
    assert (code, len(states) <= 16) == (VALID, True), (len(states), sentence)


# -- names ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    [
        "1 + 2·MX2",
        "l1·M2",
        "M1-M2",
        "M\u200b2",
        "\u202eM2",
        "M２",
        "\u041c2",
        "\u0391",
        "μ",
        "2M",
        "pi",
        "M 2",
        "ﬁ",
    ],
)
def test_names_that_may_read_as_formulas_are_not_covered(name: str) -> None:
    text = described(ARM % ("0", "0.3") + SETUPS["terms"])
    data = json.loads(text)
    data["model"]["symbols"][name] = "0.5"
    for renamed in (text.replace('"P"', json.dumps(name)), json.dumps(data)):
        code, sentence = judge(renamed)
        assert code == NOT_COVERED
        assert f"names that may read as formulas: {name!a}" in sentence


def test_a_symbol_that_is_called_like_a_parameter_is_not_covered() -> None:
    data = json.loads(described(ARM % ("0", "0.3")))
    data["model"]["symbols"]["M2"] = "0.5"
    assert judge(json.dumps(data))[0] == NOT_COVERED


def test_names_of_bodies_and_joints_may_be_any(tmp_path: Path) -> None:
    text = derived(
        ARM.replace("name: two", 'name: "left arm-2, Größe"').replace(
            "parent: two", 'parent: "left arm-2, Größe"'
        )
        % ("0", "0.3"),
        tmp_path,
    )
    assert judge(text)[0] == VALID


# -- what it does not -------------------------------------------------------------------------------------------------

UNCOVERED = {
    "knee": "couplings: [{three: 0.1*one^2}]",
    "spline": "couplings: [{three: {spline: {of: one, points: [[-1, 0.5], [0, 0], [1, 0.2]]}}}]",
    "gear of a symbol": "couplings: [{three: n*one}]",
    "stribeck": "effects: [{type: stribeck, at: one, velocity: 0.05}]",
    "signs together": "effects: [{parameter: P, unit: N, acts: [{at: one, term: 'sign(qd)*sign(qd[two])'}]}]",
    "sign of a symbol": "actuators: {m1: n*one, m2: one - two}\neffects: [{type: coulomb, at: all}]",
    "products of a sign": "effects: [{parameter: P, unit: N, acts: [{at: one, term: 'sign(qd)^2'}]}]",
    "one side": "effects: [{parameter: P, unit: N, acts: [{at: one, term: 'sign(qd^2 + 1)'}]}]",
}


def test_a_slide_stands_anywhere(tmp_path: Path) -> None:
    """At the zero of the slide the torque does not show its mass: a set without it is not complete."""
    text = "{echelon: 1, name: rp, gravity: [0, -9.81, 0], outputs: [{joint: j1}], modified_dh: "
    text += "[{joint: revolute}, {joint: prismatic, alpha: pi/2}]}"
    data = json.loads(derived(text, tmp_path))
    assert judge(json.dumps(data))[0] == VALID
    data["base"] = [row for row in data["base"] if row["name"] != "M2"]
    data["rank"] -= 1
    code, sentence = judge(json.dumps(data))
    assert (code, "not complete" in sentence) == (REFUTED, True), sentence


# -- contacts ----------------------------------------------------------------------------------------------------------

WALKER = """
echelon: 1
name: walker
gravity: [0, 0, -9.81]
bodies:
  - {name: trunk, joint: {type: floating}}
  - {name: hip, parent: trunk, joint: {type: revolute, axis: y, origin: {xyz: [0.3, 0.1, 0]}}}
  - {name: leg, parent: hip, joint: {type: prismatic, axis: z, origin: {xyz: [0, 0, -0.2], rpy: [0.3, 0, 0]}}}
  - {name: arm, parent: trunk, joint: {type: revolute, axis: x, origin: {xyz: [-0.3, 0, 0.1]}}}
contacts: [%s]
"""
FOOT, HAND = (
    "{body: leg, at: {xyz: [0, 0.1, -0.2]}",
    "{body: arm, at: {xyz: [0, 0, 0.2], rpy: [0.2, 0, 0]}",
)
CONTACTS = {
    "point": f"{FOOT}}}",
    "line": f"{FOOT}, type: line}}",
    "surface": f"{FOOT}, type: surface}}",
    "rolling": f"{FOOT}, type: rolling, radius: 0.05}}",
    "two": f"{FOOT}}}, {HAND}}}",
    "plate": f"{FOOT}, measured: [fx, fz]}}, {HAND}, type: line, measured: [ty]}}",
    "sensors": f"{FOOT}, type: line}}]\noutputs: [{{wrench: leg}}, {{joint: arm}}, {{wrench: trunk}}",
    "steps": f"{FOOT}}}, {HAND}, name: hand}}]\nexperiments: [{{name: one, contacts: [leg]}}, {{name: other, contacts: [hand]}}",
}


@pytest.mark.parametrize("case", one_in(2, CONTACTS))
def test_contacts(case: str, tmp_path: Path) -> None:
    """A set is valid as it stands, and neither without one of its rows nor under other contacts."""
    text = derived(WALKER % CONTACTS[case], tmp_path)
    code, sentence = judge(text)
    assert code == VALID, sentence
    rows = json.loads(text)["base"]
    for row in rows[:: len(rows) // 4]:
        data = json.loads(text)
        data["base"].remove(row)
        data["rank"] -= 1
        code, sentence = judge(json.dumps(data))
        assert code == REFUTED, (row, sentence)
    data = json.loads(text)
    data["model"]["contacts"] = []
    if json.loads(derived(WALKER % "", tmp_path))["rank"] != data["rank"]:
        assert judge(json.dumps(data))[0] == REFUTED


def test_signs_beside_contacts_are_not_covered(tmp_path: Path) -> None:
    text = WALKER % CONTACTS["point"] + "effects: [{type: coulomb, at: hip}]\n"
    code, sentence = judge(derived(text, tmp_path))
    assert (code, "the sign of" in sentence) == (NOT_COVERED, True), sentence


@pytest.mark.parametrize("case", UNCOVERED)
def test_what_is_not_covered_is_not_called_valid(case: str, tmp_path: Path) -> None:
    code, sentence = judge(derived(ARM % ("0", "pi/2") + UNCOVERED[case], tmp_path))
    assert (code, sentence.startswith("NOT checked")) == (NOT_COVERED, True), sentence


@pytest.mark.parametrize("angle", ["pi/23", "1/3"])
def test_angles_that_are_not_covered(angle: str, tmp_path: Path) -> None:
    code, sentence = judge(derived(ARM % (angle, "0.7"), tmp_path))
    assert (code, angle in sentence) == (NOT_COVERED, True), sentence


def test_it_can_be_read_in_half_an_hour() -> None:
    lines = Path(echelon_verify.__file__).read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 380
    assert max(map(len, lines)) <= 140


def test_it_has_its_own_kinematics(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fault that derivation and verification share passes both: here, forgotten gravity."""
    from echelon.robot.steps import Recorder

    monkeypatch.setattr(Recorder, "gravity", lambda recorder: recorder.zeros)
    model = ec.base_parameters(arms.double_pendulum())
    assert ec.verify(model).rank == 4
    code, sentence = judge(to_json(model))
    assert code == REFUTED
    assert "not complete" in sentence


def test_keys_that_stand_twice_are_refused() -> None:
    text = to_json(ec.base_parameters(arms.double_pendulum()))
    assert judge(text.replace('"rank"', '"rank": 5, "rank"', 1))[0] == REFUTED
    assert judge(json.dumps({**json.loads(text), "extra": 1}))[0] == NOT_COVERED


SMALL = ("double_pendulum", "scara", "gripper_coupled", "furuta", "loops/parallelogram")
ALL = (*SMALL, "coupled_arm", "rx90", "tx40", "floating_tree", "loops/four_bar")
CLAIMS = (
    "name",
    "rank",
    "outputs",
    "parameters",
    "order",
    "base",
    "classification",
    "generic",
    "model",
)
EVERY_LINK = ReadingOptions(keep_fixed_links=True)
VALID, REFUTED, UNREADABLE, NOT_COVERED = range(4)
# The independent verifier passes over what is said beside the rows, and over evidence of others: the program refuses
# these, and sets that are true but hold the certificate of another model.
ONLY_THE_PROGRAM = {
    *(
        "certificate",
        "class",
        "count",
        "expression",
        "expression_hidden",
        "missing",
        "order",
        "pivot",
    ),
    *(
        "generic",
        "shape",
        "special",
        "swap_columns",
        "unit",
        "value",
        "value_nearly",
        "zero",
    ),
}


@cache
def saved(name: str) -> str:
    return to_json(ec.base_parameters(ec.load(EXAMPLES / f"{name}.yaml")))


def is_its_own(text: str) -> bool:
    """Whether what a document claims is what is set_of from its model."""
    data, model = json.loads(text), from_json(text)
    again = to_dict(ec.base_parameters(model.mechanism, generic=data["generic"]))
    for row in (*data["base"], *again["base"]):
        row["terms"].sort(
            key=itemgetter("parameter")
        )  # in any order they are the same sum
    return all(again[key] == data[key] for key in CLAIMS if key != "model")


def is_accepted(text: str) -> bool:
    try:
        ec.verify(from_json(text))
    except (ec.InputError, ec.CertificateError):
        return False
    return True


def check(forgery: Forged) -> None:
    accepted = is_accepted(forgery.text)
    code, sentence = judge(forgery.text)
    assert (code == REFUTED) == sentence.startswith("NOT valid"), sentence
    assert code == NOT_COVERED or forgery.kind != "label", forgery
    if accepted:
        assert is_its_own(forgery.text), forgery
        assert code in (VALID, NOT_COVERED), sentence
    elif code == VALID:
        data, true = json.loads(forgery.text), json.loads(saved(forgery.name))
        assert forgery.kind in ONLY_THE_PROGRAM or data["model"] != true["model"], (
            forgery
        )
        again = set_of(data["model"]) or true
        both = np.vstack([rows(data), rows(again)])
        assert len(rows(data)) == len(rows(again)) == np.linalg.matrix_rank(both), (
            forgery
        )


def set_of(model: Any) -> dict[str, Any]:
    """The set of a model, or nothing where the program does not read all that is said about it."""
    try:
        return to_dict(
            ec.base_parameters(
                read_description(json.dumps(model).encode(), "forged", EVERY_LINK)
            )
        )
    except ec.InputError:
        return {}


def rows(data: dict[str, Any]) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """The coefficients at some values of the symbols; sets that span the same are equally true."""
    found = np.zeros((len(data["base"]), len(data["parameters"])))
    for i, term in (
        (i, term) for i, row in enumerate(data["base"]) for term in row["terms"]
    ):
        coefficient = RationalFunction(
            parse(term["coefficient"]), parse(term.get("denominator", "1"))
        )
        values = {
            name: 0.3 + len(name) / 7 + sum(map(ord, name)) / 999
            for name in coefficient.symbols()
        }
        generators = {
            *coefficient.numerator.generators(),
            *coefficient.denominator.generators(),
        }
        column = data["parameters"].index(term["parameter"])
        found[i, column] += coefficient.evaluate(
            float_generators(generators, values), float
        )
    return found


@pytest.mark.parametrize("third", one_in(3, range(3)))
def test_forgeries_are_refused(third: int) -> None:
    sets = {name: saved(name) for name in SMALL}
    for forgery in list(forged(sets, len(FORGERIES), seed=0))[third::3]:
        check(forgery)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_more_forgeries_are_refused(seed: int) -> None:
    sets = {name: saved(name) for name in SMALL}
    for forgery in forged(sets, len(FORGERIES), seed=seed):
        check(forgery)


@pytest.mark.slow
@pytest.mark.parametrize("hundred", range(10))
def test_a_thousand_forgeries_are_refused(hundred: int) -> None:
    for forgery in forged({name: saved(name) for name in ALL}, 100, seed=100 + hundred):
        check(forgery)
