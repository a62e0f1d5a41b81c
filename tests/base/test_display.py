"""How sets are shown: golden files, LaTeX that another program can read, hostile names, and every kind of remark.

``ECHELON_UPDATE_GOLDENS=1 pytest tests/base/test_display.py`` writes the golden files anew; read the difference.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import replace

import pytest
import sympy

import echelon as ec
from echelon.base.display import to_html, to_latex, to_markdown, to_text
from echelon.base.expression import LatexStyle, TextStyle, count_terms
from echelon.base.reading_report import ReadingReport
from echelon.base.saved.saved import from_json, to_json
from echelon.cli.terminal import print_model
from echelon.formats.robot_file import RobotFile
from echelon.robot.joint import Symbol
from echelon.robot.mechanism import Mechanism, Snap
from support import textbook_arms as arms
from support.derived import base_of
from support.paths import TESTS
from support.selection import one_in
from support.unchecked_names import unchecked_names

GOLDENS = TESTS / "goldens"
WRITERS: dict[str, Callable[[ec.BaseModel], str]] = {
    "txt": to_text,
    "md": to_markdown,
    "tex": to_latex,
    "html": to_html,
}


SHOWN: dict[str, Callable[[], ec.BaseModel]] = {
    "double_pendulum": lambda: base_of(arms.double_pendulum),
    "inclined": lambda: base_of(arms.inclined),
    "slanted": lambda: base_of(arms.slanted),
    "tx40": lambda: base_of("tx40"),
    "panda_masses": lambda: base_of(arms.panda, prefer=("M",)),
}


GOLDEN = [
    *(f"double_pendulum.{ending}" for ending in WRITERS),
    "inclined.tex",
    "slanted.md",
    "panda_masses.txt",
]


@pytest.mark.parametrize("file", GOLDEN)
def test_golden(file: str) -> None:
    golden, (name, ending) = GOLDENS / file, file.split(".")
    text = re.sub(
        r"mod \d{10}", "mod <prime>", WRITERS[ending](SHOWN[name]())
    )  # the prime depends on the seed
    if os.environ.get("ECHELON_UPDATE_GOLDENS"):
        golden.write_text(text, encoding="utf-8")
    assert text == golden.read_text(encoding="utf-8")


def test_no_golden_is_forgotten() -> None:
    assert sorted(GOLDEN) == sorted(
        file.name for file in GOLDENS.iterdir() if file.is_file()
    )


# -- the meaning of the text ------------------------------------------------------------------------------------------

AS_PYTHON = {"·": "*", "−": "-", "²": "**2", "³": "**3", "⁴": "**4"}


def meaning(text: str, values: dict[str, float]) -> float:
    """Value of an expression in our notation, as sympy reads it."""
    text = re.sub(r"(cos|sin)([²³⁴])\((\w+)\)", r"\1(\3)\2", text)
    text = re.sub(r"√(\d)", r"sqrt(\1)", re.sub(r"(\d)√", r"\1*√", text))
    for mark, python in AS_PYTHON.items():
        text = text.replace(mark, python)
    return float(
        sympy.sympify(
            text, {name: sympy.Float(value) for name, value in values.items()}
        )
    )


@pytest.mark.parametrize(
    "robot",
    [
        arms.rx90,
        arms.puma560,
        arms.inclined,
        arms.slanted,
        arms.branched,
        lambda: arms.general_arm(3),
    ],
)
@pytest.mark.parametrize("prefer", [(), *one_in(2, [("MZ", "YY"), ("M",)])])
def test_the_text_means_what_b_says(
    robot: Callable[[], Mechanism], prefer: tuple[str, ...]
) -> None:
    """Signs, parentheses, powers, roots and quotients."""
    model = ec.base_parameters(robot(), prefer=prefer)
    standard = {name: 0.3 + 0.013 * k for k, name in enumerate(model.parameters)}
    lengths = {name: 0.4 + 0.17 * k for k, name in enumerate(model.matrix.symbols)}
    expected = model.values([*standard.values()], lengths)
    for expression, value in zip(model.expressions, expected, strict=True):
        assert meaning(str(expression), standard | lengths) == pytest.approx(
            value, rel=1e-9
        )


# -- LaTeX ------------------------------------------------------------------------------------------------------------

COMMANDS = {
    "bar",
    "zeta",
    "mathit",
    "mathrm",
    "frac",
    "tfrac",
    "sqrt",
    "cos",
    "sin",
    "begin",
    "end",
}


@pytest.mark.parametrize("name", SHOWN)
def test_latex_needs_amsmath_only_and_is_balanced(name: str) -> None:
    model = SHOWN[name]()
    for text in (to_latex(model), model._repr_latex_()):
        assert set(re.findall(r"\\([a-zA-Z]+)", text)) <= COMMANDS
        assert text.count("{") == text.count("}")
        assert text.count("$") % 2 == 0
        assert text.count("&=") == model.rank
    pages = -(-model.rank // 40)
    assert (
        to_latex(model).count(r"\begin{align*}")
        == to_latex(model).count(r"\end{align*}")
        == pages
    )


def parses(latex: str) -> bool:
    import matplotlib.mathtext as mathtext

    return bool(
        mathtext.MathTextParser("path").parse(f"${latex.replace('tfrac', 'frac')}$")
    )  # all but \tfrac


@pytest.mark.parametrize("name", one_in(2, SHOWN))
def test_latex_is_understood_by_matplotlib(name: str) -> None:
    assert all(parses(expression.latex) for expression in SHOWN[name]().expressions)


@pytest.mark.parametrize(
    "label",
    ["_gripper", "left%$", "a^b~c", "{open", "back\\slash", "two\nlines", "ζ", "1.5"],
)
def test_latex_of_any_label(label: str) -> None:
    bodies = tuple(
        replace(b, label=f"{label}{i}")
        for i, b in enumerate(arms.double_pendulum().bodies)
    )
    with unchecked_names():
        model = ec.base_parameters(replace(arms.double_pendulum(), bodies=bodies))
    assert all(parses(expression.latex) for expression in model.expressions)
    assert len(to_text(model).splitlines()) == len(
        to_text(SHOWN["double_pendulum"]()).splitlines()
    )


# -- hostile names ----------------------------------------------------------------------------------------------------

HOSTILE = "<script>|`*\\end{align*}\n\\input{x}\x1b[31m"


@pytest.fixture(scope="module")
def hostile() -> ec.BaseModel:
    arm = arms.double_pendulum()
    with unchecked_names():
        bodies = tuple(replace(body, name=HOSTILE) for body in arm.bodies)
        model = ec.base_parameters(replace(arm, name=HOSTILE, bodies=bodies))
    snap = Snap(HOSTILE, "1", "2", 1e-3)
    return replace(model, reading=ReadingReport((snap,), (HOSTILE,), 7, (snap,)))


def test_names_cannot_end_a_line_or_colour_the_terminal(hostile: ec.BaseModel) -> None:
    plain = replace(
        hostile, reading=ReadingReport((Snap("x", "1", "2", 1e-3),), ("note",), 7)
    )
    named = replace(plain, mechanism=arms.double_pendulum())
    for write in WRITERS.values():
        assert "\x1b" not in write(hostile)
        assert write(hostile).count("\n") == write(named).count("\n")


def test_names_cannot_leave_a_latex_comment(hostile: ec.BaseModel) -> None:
    assert all(
        line.startswith("%")
        for line in to_latex(hostile).splitlines()
        if "script" in line
    )


def test_names_cannot_write_html(hostile: ec.BaseModel) -> None:
    assert "<script" not in to_html(hostile)
    assert "<script" not in hostile._repr_html_()
    assert not re.search(r"(?<!\\)<script", to_markdown(hostile))


def test_names_cannot_break_a_markdown_table(hostile: ec.BaseModel) -> None:
    rows = [line for line in to_markdown(hostile).splitlines() if line.startswith("|")]
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {4, 12}


def test_names_cannot_format_the_terminal_table(
    hostile: ec.BaseModel, capsys: pytest.CaptureFixture[str]
) -> None:
    arm = hostile.mechanism
    marked = replace(
        arm, bodies=tuple(replace(b, name="[red]robot[/red]") for b in arm.bodies)
    )
    print_model(replace(hostile, mechanism=marked))
    shown = capsys.readouterr().out
    assert "[red]robot[/red]" in shown
    assert "\x1b" not in shown


# -- remarks ----------------------------------------------------------------------------------------------------------

FINE, COARSE = (
    Snap("joint 'a' roll", "1.5707963", "90°", 2.7e-8),
    Snap("joint 'b' roll", "1.57", "90°", 8e-4),
)
TINY = Snap("joint 'a' roll", "1.57079632679", "90°", 4.9e-12)
REMARKS = {
    "rounding only": ReadingReport((TINY,)),
    "gives 6 too": ReadingReport((FINE, COARSE), (), 6),
    "would give 9 instead of 6, because of joint 'b' roll: 1.57 read as 90°": ReadingReport(
        (FINE, COARSE), (), 9, (COARSE,)
    ),
    "2 taken as exact, largest change 0.0008": ReadingReport((FINE, COARSE), (), 6),
    "note: something to know": ReadingReport((), ("something to know",)),
}


@pytest.mark.parametrize("remark", REMARKS)
def test_remarks_on_the_reading(remark: str) -> None:
    model = replace(SHOWN["double_pendulum"](), reading=REMARKS[remark])
    assert remark in to_text(model).splitlines()[-3]
    assert remark in to_latex(model)
    assert remark in to_markdown(model)


def test_symbols_without_value_are_not_invented() -> None:
    mechanism = replace(arms.double_pendulum(), symbols={"l1": Symbol("l1")})
    assert "symbols: l1 = ?" in to_text(ec.base_parameters(mechanism))


def test_multiples_of_angles_are_shown() -> None:
    square, sine = "cos(40*a)", "sin(40*d4)"
    assert (TextStyle().generator(square, 2), TextStyle().generator(sine, 1)) == (
        "cos²(40·a)",
        "sin(40·d4)",
    )
    assert LatexStyle().generator(square, 2) == r"\cos^{2}(40\,a)"
    assert LatexStyle().generator(sine, 1) == r"\sin(40\,d_{4})"


OBLIQUE = """echelon: 1
name: oblique
symbols: {{l: {l}}}
bodies:
  - {{name: a, joint: {{type: revolute, axis: z}}}}
  - {{name: b, frame: {{xyz: [l, 0.2, 0.3], rpy: [0.1, 0.2, 0.3]}}, joint: {{type: revolute, axis: [0.2, 0.3, 1]}}}}
"""


def oblique() -> Mechanism:
    return RobotFile.of(OBLIQUE.format(l="0.3").encode(), "oblique.yaml").mechanism()


@pytest.mark.parametrize("writer", [to_text, to_markdown, to_latex])
def test_a_long_coefficient_is_printed_as_its_value(writer: Callable[..., str]) -> None:
    base = base_of(oblique)
    lengths = [count_terms(c) for row in base.matrix.rows for c in row.values()]
    assert max(lengths) > 20
    assert max(e.longest for e in base.readable) <= 12
    short, whole = writer(base), writer(base, full=True)
    assert len(whole) > 1.5 * len(short)
    assert "--full" in short
    assert "--full" not in whole
    # where one stood, its value is
    values = base.B_float()
    for row, expression in enumerate(base.readable):
        for group in expression.groups:
            if group.decimal:
                column = base.parameters.index(group.parameters[0])
                assert group.coefficient.evaluate({}, float) == pytest.approx(
                    values[row, column], rel=1e-12
                )
    assert all(len(str(e)) < 2000 for e in base.readable)


def test_without_values_the_number_of_terms_stands_there() -> None:
    base = ec.base_parameters(
        RobotFile.of(OBLIQUE.format(l="null").encode(), "oblique.yaml").mechanism()
    )
    text = str(base)
    assert re.search(r"\(\d\d terms\)·M2", text)
    assert r"\text{" in to_latex(base)
    assert from_json(to_json(base)).expressions == base.expressions
