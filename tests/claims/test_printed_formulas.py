"""Formulas as papers print them: read as they are meant, or refused, whatever stands around them."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.algebra import Polynomial, RationalFunction
from echelon.base.claims.notation import Notation
from echelon.base.claims.reading import LinearReader
from support.command_line import run
from support.published_sets import RX90_FILE, base

PAPER = """From the paper, Table 2: "The 36 base inertial parameters of the RX 90", modified Denavit-Hartenberg frames
(Khalil and Kleinfinger), lengths D3 = 0.45 m, RL4 = 0.45 m, gravity along -z0. Joint rotors are neglected.

ZZ1R = ZZ1 + YY2 + YY3 + D3^2 (M3 + M4 + M5 + M6)
XX2R = XX2 − YY2 − D₃² (M3 + M4
       + M5 + M6)
XY2
XZ2R: XZ2 - D3 MZ3
YZ2; ZZ2R = ZZ2 + D_3^2(M3 + M4 + M5 + M6)
MX2R = MX2 + D3·(M3 + M4 + M5 + M6),
MY2

Link 3 of the arm:
XX3R = XX3 - YY3 + YY4 + 2 RL4 MZ4 + RL4^2 (M4 + M5 + M6)
XY3, XZ3, YZ3
ZZ3R = ZZ3 + YY4 + 2RL4 MZ4 + RL4²(M4 + M5 + M6)
MX3
MY3R = MY3 + MZ4 + RL4 (M4 + M5 + M6)
XX4R = XX4 - YY4 + YY5
XY4, XZ4, YZ4
ZZ4R = ZZ4 + YY5
MX4
MY4R = MY4 - MZ5
XX5R = XX5 - YY5 + YY6
XY5, XZ5, YZ5
ZZ5R = ZZ5 + YY6
MX5
MY5R = MY5 + MZ6
XX6R = XX6 - YY6
XY6, XZ6, YZ6, ZZ6, MX6, MY6.
"""


def test_a_table_as_it_is_printed(tmp_path: Path) -> None:
    file = tmp_path / "table.txt"
    file.write_text(PAPER)
    found = ec.audit(base(RX90_FILE), file)
    assert found.verdict is ec.Verdict.EQUAL
    assert len(found.findings) == 36
    assert [claim.where for claim in found.skipped] == ["line 1", "line 2", "line 13"]
    where = {f.claim.name: f.claim.where for f in found.findings if f.claim.name}
    assert (where["XX2R"], where["ZZ2R"]) == ("lines 5 to 6", "line 9")
    assert "skipped, as no row: 3 lines of text\n  line 1: From the paper" in str(found)
    assert found.to_dict()["skipped"][2] == {
        "where": "line 13",
        "text": "Link 3 of the arm:",
    }
    file.write_text(PAPER.replace("MZ4 + RL4 (", "MZ4 - RL4 ("))
    done = run("audit", RX90_FILE, str(file))
    assert done.returncode == 1
    assert (
        "wrong: row 15 (line 18): MY3R = MY3 + MZ4 - RL4 (M4 + M5 + M6)\n"
        in done.stdout
    )


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("XX 3 - YY 3", "'XX 3' can be an index, a power, a product or a number"),
        ("MX2 + D3 2 M3", "'D3 2' can be an index, a power"),
        ("XX2 - YY2 (2)", r"'YY2 \(2\)' can be an index, a power"),
        (
            "(2) XX2 - YY2",
            r"'\(2\) XX2' can be a number of a row or a product: write 2: or 2\*",
        ),
        ("2. XX2 - YY2", r"'2\. XX2' can be a number of a row"),
        ("MX2 + 1/2 D3 M3", "what follows '/' before '2 D3' can belong to the divisor"),
        ("MX2 + MX3/D3 RL4", "what follows '/' before 'D3 RL4' can belong"),
        ("MX2 + 0,45 M3", "comma between digits: write 0.45"),
        ("M3(M4)", "the product of M3 and M4 is not linear"),
        ("MX2 + a b M3", "'a' is neither a standard parameter"),
        ("MX2 + d3 M3", r"'d3' is neither a standard parameter .*nearest: M3, D3;"),
        ("MX2 + sin D3 M3", r"'sin D3': write sin\(D3\)"),
        ("MX2 + D3 M₃₋₆", "'₋' is not allowed in an expression"),
        ("MX2 + D3 (M3 + … + M6)", "'…' is not allowed in an expression"),
        ("MX2 + D3²3 M3", r"'2 3' can be an index"),
        ("MX2 and MY2", "'and' is not allowed in an expression: 'MX2 and MY2'"),
        ("− XX2 - YY2", "begins with '-': put it behind the line before"),
        ("MX2 = XX2R = 0.3", "is no row: write NAME = EXPRESSION"),
        ("MX2:", "'MX2:' is no row"),
        ("D3 = 0.45", "the term 9/20 stands without a standard parameter"),
        ("Results", "'Results' is neither a standard parameter"),
        ("12", "the term 12 stands without a standard parameter"),
        (
            "the row MX2 of link 2",
            "'the' is neither a standard parameter|can be an index",
        ),
    ],
)
def test_what_can_be_read_in_two_ways_is_refused(
    text: str, problem: str, tmp_path: Path
) -> None:
    file = tmp_path / "table.txt"
    file.write_text(f"XY2\n\n{text}\n")
    with pytest.raises(ec.InputError, match=f"line 3: .*{problem}"):
        ec.audit(base(RX90_FILE), file)


def test_all_rows_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    file = tmp_path / "table.txt"
    file.write_text("XY2\nXX 3\nMX2 + q M3\nXZ3\n- YZ3\n")
    with pytest.raises(ec.InputError) as caught:
        ec.audit(base(RX90_FILE), file)
    text = str(caught.value)
    assert "3 rows cannot be read: line 2: 'XX 3'" in text
    assert "; line 3: 'q' is neither" in text
    assert "; line 5: '- YZ3' begins with '-'" in text


def test_numbers_of_rows_are_no_factors(tmp_path: Path) -> None:
    file = tmp_path / "table.txt"
    rows = ("XY2", "YZ2", "MY2")
    file.write_text("".join(f"{k} {row}\n" for k, row in enumerate(rows, 1)))
    with pytest.raises(ec.InputError, match="the rows begin with 1, 2, 3 …"):
        ec.audit(base(RX90_FILE), file)
    file.write_text("".join(f"{k}: {row}\n" for k, row in enumerate(rows, 1)))
    found = ec.audit(base(RX90_FILE), file)
    assert [f.claim.name for f in found.findings] == ["1", "2", "3"]


def test_text_without_rows_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "table.txt"
    file.write_text("What the paper says.\nNothing of use.\n")
    with pytest.raises(
        ec.InputError, match="no line holds a standard parameter: line 1: What the"
    ):
        ec.audit(base(RX90_FILE), file)


def test_ignored_rows_beside_remarks_are_the_reason(tmp_path: Path) -> None:
    file = tmp_path / "table.txt"
    file.write_text("What the paper says.\nXY2\n")
    with pytest.raises(ec.InputError, match="every row is ignored"):
        ec.audit(base(RX90_FILE), file, ignore=["XY2"])


def test_names_that_are_formulas_of_others() -> None:
    notation = Notation(["M_a-M1", "M1", "M_a", "M_left arm"], ["e3", "D3", "D_3"])
    assert notation.plain("2 M_left arm + M1") == (
        "2 *word_0_ + M1",
        {"word_0_": "M_left arm"},
    )
    with pytest.raises(
        ValueError, match="'M_a-M1' is the name of a parameter and a formula of M_a, M1"
    ):
        notation.plain("M_a-M1")
    with pytest.raises(ValueError, match="'2e3' is a number, but e3 is a symbol"):
        notation.plain("2e3 M1")
    assert notation.names_in("D_3 M1 + D3 M_1") == ["D_3", "M1", "D3", "M1"]


# -- every notation reads back -----------------------------------------------------------------------------------------

SYMBOLS = ("D3", "RL4", "l1", "d")
PARAMETERS = ("M3", "MZ4", "XX2", "YY12", "Fv_a")
NOTATION = Notation(PARAMETERS, SYMBOLS)
READER = LinearReader(
    lambda name: name if name in PARAMETERS else None, Polynomial.generator
)
_POWERS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
_INDICES = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")

Factors = tuple[int, tuple[tuple[str, int], ...]]  # a number, and powers of symbols
Term = tuple[bool, Factors, tuple[tuple[bool, str], ...]]  # minus, factors, parameters
factors = st.tuples(
    st.integers(1, 120),
    st.lists(st.tuples(st.sampled_from(SYMBOLS), st.integers(1, 12)), max_size=3).map(
        tuple
    ),
)
signed = st.tuples(st.booleans(), st.sampled_from(PARAMETERS))
terms = st.lists(
    st.tuples(
        st.booleans(), factors, st.lists(signed, min_size=1, max_size=3).map(tuple)
    ),
    min_size=1,
    max_size=4,
)


def meaning(formula: list[Term]) -> dict[str, RationalFunction]:
    """The coefficients, by arithmetic on polynomials."""
    total: dict[str, Polynomial] = {}
    for minus, (number, powers), parameters in formula:
        value = Polynomial.constant(-number if minus else number)
        for symbol, power in powers:
            value = value * Polynomial.generator(symbol) ** power
        for negative, name in parameters:
            before = total.get(name, Polynomial.constant(0))
            total[name] = before + (-value if negative else value)
    return {n: RationalFunction(v) for n, v in total.items() if v.terms}


def indexed(name: str, style: str) -> str:
    """A name as papers print its index."""
    if style == "unicode":
        return name.translate(_INDICES)
    letters = name.rstrip("0123456789")
    tight = style == "underscores" and letters != name and "_" not in name
    return f"{letters}_{name[len(letters) :]}" if tight else name


def printed(formula: list[Term], style: str) -> str:
    """The formula in a notation."""
    minus, times = (" − ", "·") if style == "unicode" else (" - ", " ")
    times = {"stars": "*", "nothing": ""}.get(style, times)
    text = ""
    for negative, (number, powers), parameters in formula:
        shown = [str(number)] if number != 1 else []
        for symbol, power in powers:
            raised = (
                str(power).translate(_POWERS) if style == "unicode" else f"^{power}"
            )
            shown.append(indexed(symbol, style) + (raised if power != 1 else ""))
        names = [("-" if k else "") + indexed(name, style) for k, name in parameters]
        inside = "".join(
            f"{minus if n[0] == '-' else ' + '}{n.lstrip('-')}" if i else n
            for i, n in enumerate(names)
        )
        inside = f"({inside})" if len(names) > 1 or inside[0] == "-" else inside
        # without a blank a name would go on
        gap = "" if inside[0] == "(" and style != "stars" else times or " "
        factor = (times or " ").join([*shown]) + (gap if shown else "")
        text += (minus if negative else " + " if text else "") + factor + inside
    return text


@pytest.mark.parametrize(
    "style", ["stars", "blanks", "nothing", "unicode", "underscores"]
)
@given(formula=terms)
def test_printed_formulas_read_back(style: str, formula: list[Term]) -> None:
    text = printed(formula, style)
    python, _ = NOTATION.plain(text)
    assert READER.read(python) == meaning(formula), text
