"""Names that would let a row of a result read as another are refused where they enter; those of real robots are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

import echelon as ec
from echelon.shared.errors import InputError
from echelon.shared.names import (
    check_distinct,
    check_identifier,
    check_title,
    skeleton,
    symbol_stem,
)
from support import textbook_arms as arms

FORMULAS = [
    "1 + 2·MX2",
    "l1·M2",
    "l1*M2",
    "MX1 + MX2",
    "ZZ1-M2",
    "M2²",
    "M2^2",
    "1 + 2",
    "M1 − M2",
    "2×M1",
]
HIDDEN = {
    "M2\u200b": "U+200B",
    "a\u200dm": "U+200D",
    "a\u00adm": "U+00AD",
    "\ufeffarm": "U+FEFF",
    "arm\u202e1XM": "U+202E",
    "\u2066arm": "U+2066",
    "arm\u3164": "U+1160",
    "arm\ufe0f": "U+FE0F",
    "a\u034frm": "U+034F",
    "arm\u2800": "U+2800",
    "זרוע": "U+05D6",
    "ذراع": "U+0630",
    "arm\n2": "U+000A",
    "arm\x1b[31m": "U+001B",
    "arm٣": "U+0663",
    "arm🦾": "U+1F9BE",
}
LOOKING_LIKE = [
    "М2",
    "Μ2",
    "А",
    "ο",
    "ν",
    "lо1",
    "wrіst",
    "МХ1",
    "ΜΧ1",
    "аrm",
    "сор",
    "1十2",
    "1一2",
    "MX1ー2",
    "pαrt",
    "ӏ1",
]
UNUSUAL_FORMS = {
    "e\u0301": "é",
    "ｌ１": "l1",
    "ﬁnger": "finger",
    "µ": "μ",
    "M²": "M2",
    "𝐌2": "M2",
    "left\u00a0arm": "left arm",
}
IDENTIFIERS = [
    "1",
    "3b",
    "l1",
    "D_4",
    "é",
    "größe",
    "θ1",
    "α2",
    "β",
    "Δx",
    "φ_max",
    "плечо",
    "左臂",
    "关节J1",
    "アーム",
    "팔",
    "भुजा",
    "แขน",
]
TITLES = [
    "wrist_1_link", "j2-left", "base link", "left/arm", "arm.l1", "robot::arm", "robot:joint", "Arm (left)", "J1+",
    "toe_b_2/2_4", "Arm - left", "M1-link", "1-2", "${name}_finger", "link[3]", "left_sĥerical_free_foot", "a=b",
    "手 L",
]  # fmt: skip


@pytest.mark.parametrize(
    "name",
    [
        *FORMULAS,
        *HIDDEN,
        *LOOKING_LIKE,
        *UNUSUAL_FORMS,
        "left arm",
        "left-arm",
        "a.b",
        "",
    ],
)
def test_what_formulas_hold_is_an_identifier(name: str) -> None:
    with pytest.raises(InputError, match=r"^here: the name "):
        check_identifier(name, "here")


@pytest.mark.parametrize("name", [*FORMULAS, *HIDDEN, *LOOKING_LIKE, *UNUSUAL_FORMS])
def test_what_stands_beside_formulas_is_no_formula(name: str) -> None:
    with pytest.raises(InputError, match=r"^here: the name "):
        check_title(name, "here", {"M1", "M2", "MX1", "MX2", "ZZ1"})


@pytest.mark.parametrize("name", IDENTIFIERS)
def test_identifiers_of_living_scripts_are_fine(name: str) -> None:
    check_identifier(name, "here")
    check_title(name, "here")


@pytest.mark.parametrize("name", TITLES)
def test_names_of_real_robots_are_fine(name: str) -> None:
    check_title(name, "here", {"M1", "MX1", "l1"})


@pytest.mark.parametrize("name", HIDDEN)
def test_a_hidden_character_is_named_by_its_number(name: str) -> None:
    with pytest.raises(InputError, match=HIDDEN[name].replace("+", r"\+")):
        check_title(name, "here")


@pytest.mark.parametrize("name", UNUSUAL_FORMS)
def test_the_usual_form_is_said(name: str) -> None:
    with pytest.raises(InputError, match=f"write '{UNUSUAL_FORMS[name]}'"):
        check_title(name, "here")


def test_a_stem_may_stand_before_letters_of_another_script() -> None:
    check_identifier("Fvплечо", "here", composed=True)
    for name in ("FvМ", "плечоFv", "Fvпleчо"):
        with pytest.raises(InputError):
            check_identifier(name, "here", composed=True)


@pytest.mark.parametrize(
    ("first", "second"),
    [("aΟ", "aO"), ("口", "ロ"), ("left arm", "left  arm"), ("へ", "ヘ"), ("ё", "ë")],
)
def test_names_that_look_the_same_are_refused(first: str, second: str) -> None:
    assert skeleton(first) == skeleton(second)
    with pytest.raises(InputError, match="look the same"):
        check_distinct([first, "other", second], "bodies")
    check_distinct([first, first], "bodies")  # one name twice is for others to judge


@pytest.mark.parametrize(
    ("first", "second"),
    [("l1", "L1"), ("a1", "α1"), ("d", "D"), ("e", "é"), ("l1", "I1")],
)
def test_names_that_can_be_told_apart_are_fine(first: str, second: str) -> None:
    check_distinct([first, second], "symbols")


# -- every way into a model --------------------------------------------------------------------------------------------

URDF = """<robot name="r"><link name="w"/><link name={body}/><link name="tip"/>
<joint name={joint} type="continuous"><parent link="w"/><child link={body}/><axis xyz="1 0 0"/></joint>
<joint name="j2" type="continuous"><parent link={body}/><child link="tip"/><axis xyz="0 0 1"/>
<origin xyz="0.3 0 0"/></joint></robot>"""
SDF = """<sdf version="1.9"><model name="r"><link name={body}/><link name="tip"/>
<joint name={joint} type="revolute"><parent>world</parent><child>{text}</child><axis><xyz>1 0 0</xyz></axis></joint>
<joint name="j2" type="revolute"><parent>{text}</parent><child>tip</child><axis><xyz>0 0 1</xyz></axis></joint>
</model></sdf>"""
MJCF = """<mujoco><worldbody><body name={body}><joint name={joint} axis="1 0 0"/><geom size="1"/>
<body name="tip" pos="0.3 0 0"><joint name="j2"/><geom size="1"/></body></body></worldbody></mujoco>"""
DESCRIPTION = """echelon: 1
symbols: {{"{symbol}": 0.3}}
bodies:
  - {{name: "{body}", label: "{label}", joint: {{type: revolute, name: "{joint}", axis: x}}}}
  - name: tip
    label: "2"
    parent: "{body}"
    joint: {{type: revolute, name: j2, axis: z, origin: {{xyz: ["{symbol}", 0, 0]}}}}
effects: [{{parameter: "{effect}", unit: N, acts: [{{at: j2, term: qd}}]}}]
"""
LINEAR = """echelon: 1
model: linear
variables: [x, y]
parameters: ["{parameter}", q]
constants: {{"{constant}": 2}}
regressor: {{"{output}": ["x", "y"]}}
"""
PLAIN = {"symbol": "l1", "body": "arm", "label": "1", "joint": "j1", "effect": "Fv"}
BAD = ["1 + 2·MX2", "l1·M2", "arm\u200b", "arm\u202e", "lеft", "Μ2", "e\u0301"]


@pytest.mark.parametrize("name", BAD)
@pytest.mark.parametrize("where", ["body", "joint"])
@pytest.mark.parametrize(
    ("text", "suffix"),
    [(URDF, "urdf"), (SDF, "sdf"), (MJCF, "xml")],
    ids=["URDF", "SDF", "MJCF"],
)
def test_files_with_such_names_are_refused(
    tmp_path: Path, text: str, suffix: str, where: str, name: str
) -> None:
    names = {"body": "arm", "joint": "j1", where: name}
    file = tmp_path / f"robot.{suffix}"
    file.write_text(
        text.format(**{k: quoteattr(v) for k, v in names.items()}, text=names["body"]),
        encoding="utf-8",
    )
    with pytest.raises(InputError, match=rf"robot\.{suffix}: {where} '.*': the name "):
        ec.load(file)


@pytest.mark.parametrize("name", BAD)
@pytest.mark.parametrize("where", PLAIN)
def test_descriptions_with_such_names_are_refused(
    tmp_path: Path, where: str, name: str
) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text(DESCRIPTION.format(**PLAIN), encoding="utf-8")
    assert ec.base_parameters(ec.load(file)).rank
    file.write_text(DESCRIPTION.format(**{**PLAIN, where: name}), encoding="utf-8")
    with pytest.raises(InputError, match=r"robot\.yaml: .*'"):
        ec.load(file)


@pytest.mark.parametrize("name", BAD)
@pytest.mark.parametrize("where", ["parameter", "constant", "output"])
def test_linear_models_with_such_names_are_refused(
    tmp_path: Path, where: str, name: str
) -> None:
    plain = {"parameter": "p", "constant": "c", "output": "y1"}
    file = tmp_path / "model.yaml"
    file.write_text(LINEAR.format(**plain), encoding="utf-8")
    assert ec.base_parameters(ec.load_linear(file)).rank
    file.write_text(LINEAR.format(**{**plain, where: name}), encoding="utf-8")
    with pytest.raises(InputError, match=rf"model\.yaml: {where} '.*': the name "):
        ec.load_linear(file)


@pytest.mark.parametrize("name", BAD)
def test_saved_sets_with_such_names_are_refused(tmp_path: Path, name: str) -> None:
    file = tmp_path / "set.json"
    ec.save_base(ec.base_parameters(arms.double_pendulum()), file)
    label = '"label": "2"'
    text = file.read_text(encoding="utf-8")
    assert label in text
    file.write_text(text.replace(label, f'"label": "{name}"'), encoding="utf-8")
    with pytest.raises(InputError, match=r"set\.json: label of body '.*': the name "):
        ec.load_base(file)


CHANGES: dict[str, Callable[[ec.Mechanism], object]] = {
    "a formula": lambda arm: replace(
        arm, bodies=(replace(arm.bodies[0], label="1 + 2"), *arm.bodies[1:])
    ),
    "two scripts": lambda arm: replace(
        arm, bodies=(replace(arm.bodies[0], label="aйO"), *arm.bodies[1:])
    ),
}


@pytest.mark.parametrize("change", CHANGES)
def test_mechanisms_made_in_python_are_checked(change: str) -> None:
    with pytest.raises(InputError, match="the name "):
        CHANGES[change](arms.double_pendulum())


def test_parameters_of_actuators_are_identifiers(tmp_path: Path) -> None:
    """A difference of two names was one name before: Fv_motor-left."""
    file = tmp_path / "robot.yaml"
    more = "actuators: {motor-left: {terms: {j2: 2}}}\n"
    text = (
        DESCRIPTION.format(**PLAIN).split("effects:")[0]
        + more
        + "effects: [{type: viscous, at: motor-left}]\n"
    )
    file.write_text(text, encoding="utf-8")
    assert ec.load(file).parameters[-1] == "Fv_motor_left"
    assert symbol_stem("left-knee") == "_left_knee"
