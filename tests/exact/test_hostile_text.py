"""Text and numbers that attack: refused where they enter, or shown as what they are."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import echelon as ec
from echelon.algebra.exact.expressions import in_double_range, is_whole, parse
from echelon.algebra.exact.polynomial import Polynomial, multiple_of, surd
from echelon.algebra.program.tape import Program
from echelon.algebra.program.text import record_expression
from echelon.base.claims.reading import LinearReader
from echelon.base.display import to_latex, to_markdown
from echelon.cli.commands import app
from echelon.cli.generate import read_values
from echelon.cli.screen import visible
from echelon.dynamics.models import constant_values
from echelon.robot.joint import Symbol
from echelon.shared.errors import InputError
from echelon.shared.names import symbol_stem
from support import textbook_arms as arms
from support.paths import ROOT

NOT_TEXT = {
    "0.3 # in metres": "comment",
    "0.3 # $\\input{/etc/passwd}": "comment",
    "(0.3\n# x\n)": "control character U\\+000A",
    "0.3\x1b[31m": "control character U\\+001B",
    "0.3\t+ 1": "control character U\\+0009",
    "0.3\x9b31m": "control character U\\+009B",
    "0.3\u2028 + 1": "control character U\\+2028",
    "0.3 + \u202e1": "control character U\\+202E",
    "0.3\\\n": "is not an expression",
    "٣": "digit U\\+0663",
    "0.3e٣": "digit U\\+0663",
    "１": "digit U\\+FF11",
    "1 + l²": "digit U\\+00B2",
    "__import__('os').system('id')": "not (allowed|an expression)",
}
BEYOND = [
    "1e400",
    "-1e999",
    "1e-400",
    "1e200*1e200",
    "1e-200/1e200",
    "1e99999999999",
    "sqrt(2)*1e308*10",
]

DESCRIPTION = """echelon: 1
name: pendulum
gravity: [0, -9.81, 0]
symbols: {l1: %s}
bodies:
  - {name: a, joint: {type: revolute, name: q1, axis: z}}
  - {name: b, parent: a, frame: {xyz: [l1, 0, 0]}, joint: {type: revolute, name: q2, axis: z}}
"""
URDF = """<robot name="r"><link name="w"/>
<link name="a"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="j1" type="revolute"><parent link="w"/><child link="a"/><origin xyz="1 0 0" rpy="0.3 0 0"/></joint></robot>
"""


@pytest.mark.parametrize("text", NOT_TEXT)
def test_an_expression_is_one_line_that_counts(text: str) -> None:
    with pytest.raises(ValueError, match=NOT_TEXT[text]):
        parse(text)


@pytest.mark.parametrize(
    "text",
    [
        t
        for t, problem in NOT_TEXT.items()
        if "allowed" not in problem and "\\\n" not in t
    ],
)
def test_every_reader_of_expressions_refuses_the_same(text: str) -> None:
    with pytest.raises(InputError, match=NOT_TEXT[text]):
        record_expression(
            f"x + {text}", {"x": Program().input("x")}, "effect", Program()
        )
    if "²" not in text:  # which claims may hold, for powers
        with pytest.raises(ValueError, match=NOT_TEXT[text]):
            LinearReader(lambda name: name, Polynomial.generator).read(f"M1 + {text}")


def test_names_in_quotes_may_hold_what_expressions_may_not() -> None:
    program = Program()
    names = {"qd[left #1]": program.input("qd[left #1]")}
    assert record_expression('2*qd["left #1"]', names, "effect", program).node


@pytest.mark.parametrize("text", BEYOND)
def test_numbers_beyond_doubles_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match="beyond the range of double precision"):
        parse(text)


@pytest.mark.parametrize(
    ("number", "inside"),
    [
        (0, True),
        (10**308, True),
        (10**309, False),
        (surd(0, 10**309, 0, 0), False),
        (surd(1, -1, 0, 0), True),
    ],
)
def test_the_range_of_doubles(number: Any, inside: bool) -> None:
    assert in_double_range(number) is inside


@pytest.mark.parametrize(
    "value",
    [
        "1e308",
        "1e400",
        "1e999",
        "1e200",
        "1e-308",
        ".inf",
        "'0.3 # x'",
        '"0.3\\e[31m"',
        "٣",
    ],
)
def test_descriptions_name_the_symbol(tmp_path: Path, value: str) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text(DESCRIPTION % value, encoding="utf-8")
    with pytest.raises(InputError, match=r"robot\.yaml: symbols\.l1: ") as caught:
        ec.load(file)
    assert "\x1b" not in str(caught.value)


@pytest.mark.parametrize("attack", [("1 0 0", "1e308 0 0"), ("0.3 0 0", "1e308 0 0"), ("0.3 0 0", "1e12 0 0"),
                                    ('mass value="1"', 'mass value="1e200"'), ("0.3 0 0", "٣ 0 0"),
                                    ("1 0 0", "1e-400 0 0")])  # fmt: skip
def test_robot_files_name_the_element(tmp_path: Path, attack: tuple[str, str]) -> None:
    file = tmp_path / "robot.urdf"
    file.write_text(URDF.replace(*attack), encoding="utf-8")
    with pytest.raises(InputError, match=r"robot\.urdf: (joint 'j1'|link 'a')"):
        ec.load(file)


@pytest.mark.parametrize(
    "gravity",
    [
        "0,0,1e400",
        "0,0,1e308",
        "0,0,1e-308",
        "0,0,inf",
        "0,0,-9.81 # down",
        "0,0,９",
        "0,0,nan",
    ],
)
def test_gravity_is_checked(gravity: str) -> None:
    with pytest.raises(InputError, match="gravity: "):
        ec.load(ROOT / "examples/two_link.xml", gravity=gravity)


def test_gravity_in_numbers_is_finite() -> None:
    with pytest.raises(InputError, match="not a finite number"):
        ec.load(ROOT / "examples/double_pendulum.yaml", gravity=(0, 0, float("inf")))


@pytest.mark.parametrize("value", ["1e400", "9" * 40 + "e300000000", "٣", "1 # x"])
def test_constants_of_models_are_read_like_expressions(value: str) -> None:
    with pytest.raises(InputError, match="is not a number"):
        constant_values({"m": value})


@pytest.mark.parametrize(
    "text", ['{"M1": 1e999}', '{"M1": true}', "M1,1e400", "M1,٣", '{"M1": "0.3 # x"}']
)
def test_values_of_parameters_are_finite(tmp_path: Path, text: str) -> None:
    file = tmp_path / "values.txt"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"values\.txt"):
        read_values(file)


@pytest.mark.parametrize(
    ("text", "whole"),
    [("12", True), ("²", False), ("٣", False), ("-1", False), ("9" * 30, False)],
)
def test_whole_numbers_have_ascii_digits(text: str, whole: bool) -> None:
    assert is_whole(text) is whole


# -- what is shown -----------------------------------------------------------------------------------------------------


def with_exact(exact: str) -> ec.BaseModel:
    base = ec.base_parameters(arms.double_pendulum())
    name = next(iter(base.mechanism.symbols))
    symbols = {**base.mechanism.symbols, name: Symbol(name, 0.3, exact)}
    return replace(base, mechanism=replace(base.mechanism, symbols=symbols))


def test_exact_values_are_read_and_never_evaluated(tmp_path: Path) -> None:
    proof = tmp_path / "proof"
    with pytest.raises(InputError, match="symbol 'l1'"):
        _ = with_exact(f"__import__('pathlib').Path({str(proof)!r}).touch()").B_exact
    assert not proof.exists()
    assert str(with_exact("sqrt(2)*pi/4").B_exact[0, 19]) in ("0", "pi**2/8")


@pytest.mark.parametrize(
    ("exact", "shown"),
    [("2*pi/3", r"\tfrac{2}{3}\,\pi"), ("0.3", "0.3"), ("1e-3", r"\tfrac{1}{1000}")],
)
def test_latex_shows_values_as_formulas(exact: str, shown: str) -> None:
    assert f"l_{{1}} = {shown}$" in to_latex(with_exact(exact))


def test_latex_refuses_what_is_no_expression() -> None:
    with pytest.raises(InputError, match="comment"):
        to_latex(with_exact("0.3 # $\\input{/etc/passwd}"))


def test_terminals_and_json_get_printable_characters() -> None:
    name = "é\x9b31m\u202e"
    assert visible(f"{name}\nsecond") == "é\\u009b31m\\u202e\nsecond"
    assert json.loads(visible(json.dumps({"n": name}, ensure_ascii=False))) == {
        "n": name
    }


@pytest.mark.parametrize("arguments", [(), ("--json",), ("-f", "latex"), ("-f", "markdown"), ("--rank-only",),
                                       ("--regressor", "sympy")])  # fmt: skip
def test_names_from_files_reach_no_terminal_as_codes(
    tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    name, part = "*/ \x9b31m\u202e $x$ {0} &lt;b&gt; %", "/ $x$ {0} &lt;b&gt; %"
    text = (
        URDF.replace('"r"', f'"{name}"')
        .replace('"a"', f'"{part}"')
        .replace('"j1"', f'"2{part}"')
    )
    (tmp_path / "robot.urdf").write_text(text, encoding="utf-8")
    done = CliRunner().invoke(app, ["derive", str(tmp_path / "robot.urdf"), *arguments])
    assert (done.exit_code, done.stderr) == (0, "")
    assert all(c.isprintable() or c == "\n" for c in done.stdout)


def test_markdown_escapes_formulas() -> None:
    base = ec.base_parameters(replace(arms.double_pendulum(), name="$x$ <b>"))
    assert "\\$x\\$ \\<b>" in to_markdown(base)


@pytest.mark.parametrize(
    ("generator", "found"),
    [
        ("cos(40*a)", (40, "a")),
        (f"cos({10**30}*a)", (10**30, "a")),
        ("sin(q[2*x])", (1, "q[2*x]")),
        ("cos(q[*/ x])", (1, "q[*/ x]")),
    ],
)
def test_names_with_stars_are_no_multiples(
    generator: str, found: tuple[int, str]
) -> None:
    assert multiple_of(generator) == found


def test_symbols_are_named_with_characters_that_are_read_back() -> None:
    stem = symbol_stem("a² ٣ｘ-é")
    assert re.fullmatch(r"[_a-zé]+", stem)
    assert parse(f"px{stem}").symbols() == [f"px{stem}"]


# -- saved sets --------------------------------------------------------------------------------------------------------


def saved(tmp_path: Path, change: Any) -> Path:
    """A saved pendulum with 1/l1 among its coefficients, changed."""
    robot = tmp_path / "robot.yaml"
    robot.write_text(DESCRIPTION % "0.3")
    base = ec.base_parameters(ec.load(robot), prefer=["M2"])
    ec.save_base(base, tmp_path / "set.json")
    document = json.loads((tmp_path / "set.json").read_text())
    change(document)
    (tmp_path / "set.json").write_text(json.dumps(document))
    return tmp_path / "set.json"


def coefficient(text: str, key: str = "coefficient") -> Any:
    def change(document: dict[str, Any]) -> None:
        document["base"][0]["terms"][0][key] = text

    return change


def symbol(value: str) -> Any:
    def change(document: dict[str, Any]) -> None:
        document["model"]["symbols"]["l1"] = value

    return change


@pytest.mark.parametrize(("change", "codes"), [
    (coefficient("0"), (1, 2)), (coefficient("l1 - l1"), (1, 2)), (coefficient("0", "denominator"), (2, 2)),
    (coefficient("1e999"), (2, 2)), (coefficient("1 # x"), (2, 2)), (symbol("0"), (2, 2)), (symbol("0*pi"), (2, 2)),
    (symbol("1e-320"), (2, 2)),
])  # fmt: skip
def test_zeros_and_numbers_out_of_range_in_saved_sets(
    tmp_path: Path, change: Any, codes: tuple[int, int]
) -> None:
    file = saved(tmp_path, change)
    for arguments, code in zip(
        (["verify"], ["generate", "-o", str(tmp_path / "out")]), codes, strict=True
    ):
        done = CliRunner().invoke(app, [*arguments, str(file)])
        refused = isinstance(done.exception, InputError)
        assert (2 if refused else done.exit_code) == code
        assert "set.json" in (str(done.exception) if refused else done.stdout)


def test_a_zero_in_a_denominator_is_named() -> None:
    base = ec.base_parameters(arms.double_pendulum(), prefer=["M2"])
    assert base.matrix.denominators == {"l1"}
    with pytest.raises(InputError, match="denominator l1 is zero"):
        base.B_float({"l1": 0.0})
    with pytest.raises(InputError, match="zero at the values of the symbols"):
        _ = replace(
            base,
            mechanism=replace(base.mechanism, symbols={"l1": Symbol("l1", 0.0, "0")}),
        ).B_exact
