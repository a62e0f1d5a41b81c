"""The verifier of one file on closed loops: honest sets are valid, false ones are not, and the rest is named."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import echelon as ec
from echelon.base.saved.echelon_verify import judge
from echelon.base.saved.saved import to_json
from echelon.formats.snapping import ReadingOptions
from support.descriptions import read_description
from support.paths import ROOT
from support.selection import one_in, slow_unless

VALID, REFUTED, UNREADABLE, NOT_COVERED = range(4)
LOOPS = ROOT / "examples" / "loops"
DATA = ROOT / "tests" / "data" / "loops"

FOUR_BAR = """
echelon: 1
name: four-bar linkage
symbols: {l1: 0.4, l2: 0.15, l3: 0.35, l4: 0.3}
gravity: [0, -9.81, 0]
modified_dh:
  - {name: crank, joint: revolute}
  - {name: coupler, joint: revolute, a: l2}
  - {name: rocker, joint: revolute, parent: base, a: l1}
loops:
  - {name: pin, joint: revolute, connects: [coupler, rocker], at: {xyz: [l3, 0, 0]}, on_second: {xyz: [l4, 0, 0]}}
assembly: {crank: 1.0, coupler: -0.4816, rocker: 1.6206}
"""
# four bars with equal opposite sides stay parallel at this pose, and cross at the other one
PARALLEL = (
    FOUR_BAR.replace("l3: 0.35, l4: 0.3", "l3: 0.4, l4: 0.15")
    .replace("-0.4816", "-1.0")
    .replace("rocker: 1.6206", "rocker: 1.0")
)
CROSSED = {
    "crank": "1.0",
    "coupler": "-1.7536437793798492",
    "rocker": "-1.7536437793798492",
}
SLIDER = """
echelon: 1
name: slider crank
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: rod, parent: crank, joint: {type: revolute, axis: z, origin: {xyz: [0.3, 0, 0]}}}
loops:
  - {name: guide, joint: point_on_axis, connects: [base, rod], on_second: {xyz: [0.8, 0, 0]}, axis: x}
independent: [crank]
assembly: {crank: 0.5, rod: -0.6807766}
"""


@cache
def saved(file: Path) -> str:
    """The saved set of a file."""
    return to_json(ec.base_parameters(ec.load(file)))


@cache
def described(text: str, *, generic: bool = False) -> str:
    """The saved set of a description, for its stated values or for general ones."""
    return to_json(
        ec.base_parameters(
            read_description(text, "described", ReadingOptions()), generic=generic
        )
    )


# -- what it accepts --------------------------------------------------------------------------------------------------


# CPU seconds of the verifier alone: 0.1, 0.6, 0.7, 0.5 | 4, 2, 9
@pytest.mark.parametrize(
    ("name", "rank"),
    [
        ("parallelogram", 3),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (
                ("four_bar", 8),
                ("bennett", 9),
                ("sr400", 39),
                ("delta", 34),
                ("three_rps", 25),
                ("gough_stewart", 82),
            )
        ),
    ],
)
def test_examples(name: str, rank: int) -> None:
    code, sentence = judge(saved(LOOPS / f"{name}.yaml"))
    assert code == VALID, sentence
    assert sentence.startswith(f"valid: {rank} base parameters of ")
    assert (
        "at the stated values, minimal by pivots above 1e-80, complete to 1e-40 at 7 random states"
        in sentence
    )
    assert sentence.endswith("that motions reach from the assembly pose")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["cassie_leg.xml", "delta_pins.xml", "robotiq_2f85.xml", "five_bar/robot.yaml"],
)
@pytest.mark.filterwarnings("ignore::echelon.AssemblyWarning")
def test_published_mechanisms(name: str) -> None:
    """Coefficients that are numbers, directions with known tangents' squares, a pose that was searched for."""
    code, sentence = judge(saved(DATA / name))
    assert code == VALID, sentence
    assert sentence.endswith(
        "reading.assembled" if name.startswith("five_bar") else "the assembly pose"
    )


SETUPS = {
    "friction": "effects: [{type: viscous, at: all, side: joint}, {type: coulomb, at: all, side: joint}]",
    "two sides": "effects: [{type: asymmetric_coulomb, at: all}, {type: rotor_inertia, at: all}]",
    "springs": "effects: [{type: spring, at: [coupler, rocker], side: joint}, {type: drive_gain, at: all}]",
    "drive": "actuators: {m: 30*crank}\neffects: [{type: coulomb, at: all}, {type: rotor_inertia, at: all}]",
    "terms": "effects: [{parameter: P, unit: N·m, acts: [{at: crank, term: 'abs(qd)*qd[rocker] + 2*q^2'}]}]",
    "base": "outputs: [{wrench: base}]",
    "coupler": "outputs: [{wrench: coupler, components: [fx, fy]}, {joint: crank}]",
    "no gravity": "gravity: none",
    "any gravity": "gravity: generic",
}


@pytest.mark.parametrize("case", slow_unless(["coupler"], SETUPS))
@pytest.mark.parametrize(
    "text",
    [FOUR_BAR, pytest.param(PARALLEL, marks=pytest.mark.slow)],
    ids=["four bars", "parallel"],
)
def test_setups(text: str, case: str) -> None:
    lines = [
        line
        for line in text.splitlines()
        if not (case.endswith("gravity") and line.startswith("gravity"))
    ]
    code, sentence = judge(described("\n".join([*lines, SETUPS[case]])))
    assert code == VALID, sentence


@pytest.mark.parametrize(
    "coupled",
    [
        pytest.param(coupled, marks=pytest.mark.slow)
        for coupled in ("2*rocker", "1/2*rocker", "-50.7*rocker")
    ],
)
def test_gears_of_coordinates_that_loops_move(coupled: str) -> None:
    wheel = "  - {name: wheel, joint: revolute, parent: rocker, a: 0.1}\n"
    text = FOUR_BAR.replace(
        "loops:\n", f"{wheel}couplings: [{{wheel: {coupled}}}]\nloops:\n"
    )
    code, sentence = judge(described(text))
    assert code == VALID, sentence


def test_points_on_lines() -> None:
    code, sentence = judge(described(SLIDER))
    assert code == VALID, sentence


# -- for whom a set holds ---------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_sets_for_general_values_are_checked_near_the_stated_ones() -> None:
    code, sentence = judge(described(FOUR_BAR, generic=True))
    assert code == VALID, sentence
    assert (
        "8 base parameters of 30 for general values of the symbols near the stated ones"
        in sentence
    )


@pytest.mark.slow
def test_a_set_for_general_values_says_what_the_stated_ones_change() -> None:
    data = json.loads(described(PARALLEL, generic=True))
    assert data["special"]["rank"] == 3
    code, sentence = judge(json.dumps(data))
    assert code == VALID, sentence
    assert "(3 at the stated ones)" in sentence
    assert judge(json.dumps({**data, "special": None}))[0] == REFUTED
    assert judge(json.dumps({**data, "generic": False, "special": None}))[0] == REFUTED


def test_coefficients_that_only_the_stated_values_have_are_not_general() -> None:
    data = json.loads(described(FOUR_BAR, generic=True))
    for row in data["base"]:
        for term in row["terms"]:
            term["coefficient"] = term["coefficient"].replace("l2", "0.15")
    assert judge(json.dumps({**data, "generic": False}))[0] == VALID
    assert judge(json.dumps(data))[0] == REFUTED


# -- what it refutes --------------------------------------------------------------------------------------------------

Forge = Callable[[dict[str, Any]], object]


def _term(data: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = next(
        t for row in data["base"] for t in row["terms"] if t["parameter"] != row["name"]
    )
    return found


def _wrong(data: dict[str, Any]) -> None:
    term = _term(data)
    term["coefficient"] = f"({term['coefficient']})*1.00000000000000000000000000001"


def _fewer(data: dict[str, Any]) -> None:
    data["base"].pop()
    data["rank"] -= 1


def _more(data: dict[str, Any]) -> None:
    name = next(
        n for n in data["parameters"] if n not in {row["name"] for row in data["base"]}
    )
    data["base"].append(
        {"name": name, "terms": [{"parameter": name, "coefficient": "1"}]}
    )
    data["rank"] += 1


def _hidden(data: dict[str, Any]) -> None:
    """A column that has no effect is said to have one."""
    data["base"][0]["terms"].append({"parameter": "XX1", "coefficient": "1e-9"})


FORGED: dict[str, tuple[Forge, str]] = {
    "a coefficient": (_wrong, "not complete"),
    "a term": (lambda data: data["base"][0]["terms"].pop(), "not complete"),
    "fewer": (_fewer, "not complete"),
    "more": (_more, "not minimal"),
    "no effect": (_hidden, "not complete"),
    "gravity": (lambda data: data["model"].update(gravity="none"), "not minimal"),
}


@pytest.mark.parametrize("case", FORGED)
def test_false_sets_of_a_four_bar_linkage(case: str) -> None:
    data = json.loads(described(FOUR_BAR))
    forge, problem = FORGED[case]
    forge(data)
    code, sentence = judge(json.dumps(data))
    assert code == REFUTED, sentence
    assert problem in sentence


@pytest.mark.parametrize(
    "case",
    slow_unless(
        lambda case: case != "a coefficient",
        ["a coefficient", "a term", "fewer", "more"],
    ),
)
def test_false_sets_of_a_parallelogram(case: str) -> None:
    data = json.loads(described(PARALLEL))
    forge, problem = FORGED[case]
    forge(data)
    code, sentence = judge(json.dumps(data))
    assert code == REFUTED, sentence
    assert problem in sentence


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bennett", "sr400", "delta", "three_rps"])
@pytest.mark.parametrize("case", ["a coefficient", "fewer", "more"])
def test_false_sets_of_examples(name: str, case: str) -> None:
    data = json.loads(saved(LOOPS / f"{name}.yaml"))
    forge, problem = FORGED[case]
    forge(data)
    code, sentence = judge(json.dumps(data))
    assert code == REFUTED, sentence
    assert problem in sentence


def test_the_set_of_another_way_of_assembly_is_refuted() -> None:
    """The set for bars that stay parallel at the pose where they cross, and the other way round."""
    parallel = json.loads(described(PARALLEL))
    crossed = json.loads(
        described(PARALLEL.split("assembly:")[0] + f"assembly: {json.dumps(CROSSED)}")
    )
    assert (parallel["rank"], crossed["rank"]) == (3, 8)
    assert judge(json.dumps(crossed))[0] == VALID
    poses = [data["model"]["assembly"] for data in (parallel, crossed)]
    for data, pose, problem in zip(
        (crossed, parallel), poses, ("not minimal", "not complete"), strict=True
    ):
        data["model"]["assembly"], data["reading"]["assembled"] = pose, None
        code, sentence = judge(json.dumps(data))
        assert code == REFUTED, sentence
        assert problem in sentence


def test_it_has_its_own_closures(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fault that derivation and verification share passes both: here, forgotten gravity."""
    from echelon.robot.steps import Recorder

    monkeypatch.setattr(Recorder, "gravity", lambda recorder: recorder.zeros)
    model = ec.base_parameters(
        read_description(FOUR_BAR, "described", ReadingOptions())
    )
    assert judge(to_json(model))[0] == REFUTED


# -- what it does not cover -------------------------------------------------------------------------------------------


def changed(change: Forge, text: str = FOUR_BAR) -> tuple[int, str]:
    """The verifier's answer about a set with a changed document."""
    data = json.loads(described(text))
    data["reading"]["assembled"] = None
    change(data)
    return judge(json.dumps(data))


def _flat(data: dict[str, Any]) -> None:
    """Bars of a parallelogram that lie on one another."""
    data["model"].update(
        assembly={}, symbols={"l1": "0.4", "l2": "0.15", "l3": "0.4", "l4": "0.15"}
    )


NOT_CLOSED = "an assembly pose at which loops are not closed"
UNCOVERED: dict[str, tuple[Forge, str]] = {
    "no value": (
        lambda data: data["model"]["symbols"].update(l1=None),
        "loops with symbols that have no values",
    ),
    "an open pose": (
        lambda data: data["model"]["assembly"].update(rocker="2.5"),
        NOT_CLOSED,
    ),
    "modes that meet": (_flat, NOT_CLOSED),
    "a strange key": (
        lambda data: data["model"]["loops"][0].update(slack="0.1"),
        "slack",
    ),
    "a strange kind": (
        lambda data: data["model"]["loops"][0].update(joint="rack"),
        "a loop with 'rack'",
    ),
    "dependent ones": (
        lambda data: data["model"].update(independent=["crank", "rocker"]),
        "loops that do not close",
    ),
    "tiny numbers": (
        lambda data: data["model"]["symbols"].update(l1="0.4 + 1e-30"),
        "numbers of such sizes",
    ),
    "few digits": (
        lambda data: data.update(
            numbers={"parameters": ["M2"], "at": {}, "radius": 1e-12}
        ),
        "few digits",
    ),
}


@pytest.mark.parametrize("case", UNCOVERED)
def test_what_is_not_covered_is_not_called_valid(case: str) -> None:
    change, problem = UNCOVERED[case]
    code, sentence = changed(change)
    assert (code, problem in sentence) == (NOT_COVERED, True), sentence


@pytest.mark.parametrize(
    "term", one_in(3, ["exp(-qd^2)*qd", "sign(q)", "qd + 1e-80*q"])
)
def test_effects_that_are_not_covered(term: str) -> None:
    effect = (
        f"effects: [{{parameter: P, unit: N·m, acts: [{{at: crank, term: '{term}'}}]}}]"
    )
    code, sentence = judge(described(FOUR_BAR + effect))
    assert (code, sentence.startswith("NOT checked")) == (NOT_COVERED, True), sentence


def test_a_loop_that_cannot_move_is_not_covered() -> None:
    """A pin that is turned out of the plane by a hundredth of a degree."""
    tilted = {
        "rotation": [
            ["1", "0", "0"],
            ["0", "cos(l5)", "-sin(l5)"],
            ["0", "sin(l5)", "cos(l5)"],
        ]
    }

    def tilt(data: dict[str, Any]) -> None:
        data["model"]["symbols"]["l5"] = "0.0002"
        data["model"]["loops"][0]["at"].update(tilted)

    code, sentence = changed(tilt)
    assert code == NOT_COVERED, sentence
