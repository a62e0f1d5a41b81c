"""Interval arithmetic on programs against values in fifty digits, and programs whose jumps are smoothed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from echelon.algebra.program.intervals import interval_values
from echelon.algebra.program.operations import FUNCTIONS, Op
from echelon.algebra.program.rewriting import smoothed
from echelon.algebra.program.tape import Program, Scalar
from echelon.shared.errors import InputError
from support.excitation_cases import TRUTH, truth
from support.selection import examples

BINARY = ("add", "subtract", "multiply", "divide")
NAMES = ("x", "y")

# -- random programs ---------------------------------------------------------------------------------------------------

_LEAVES = st.sampled_from(NAMES) | st.fractions(-4, 4, max_denominator=8)


def _inner(part: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.tuples(st.sampled_from(BINARY), part, part) | st.tuples(
        st.sampled_from(FUNCTIONS), part
    )


FORMULAS = st.recursive(_LEAVES, _inner, max_leaves=8)
ENDS = st.floats(-4, 4).map(lambda x: round(x, 6)) | st.integers(-3, 3).map(float)
RANGES = st.tuples(ENDS, ENDS).map(lambda ends: (min(ends), max(ends)))


def recorded(program: Program, formula: Any) -> Scalar:
    """A formula on a program; formulas without a value are passed over."""
    if isinstance(formula, str):
        return program.input(formula)
    if isinstance(formula, Fraction):
        return program.constant(formula)
    parts = [recorded(program, part) for part in formula[1:]]
    try:
        if len(parts) == 1:
            return program.function(formula[0], parts[0])
        return Scalar(
            program, getattr(program, formula[0])(parts[0].node, parts[1].node)
        )
    except (InputError, ZeroDivisionError):
        assume(False)
        raise


def enclosed(
    program: Program, output: int, ranges: Mapping[str, tuple[float, float]]
) -> tuple[float, float]:
    inputs = {
        program.input(name).node: (np.array(low), np.array(high))
        for name, (low, high) in ranges.items()
    }
    ((low, high),) = interval_values(program, [output], inputs)
    return float(low), float(high)


# -- enclosures --------------------------------------------------------------------------------------------------------


@examples(300)
@given(
    FORMULAS,
    RANGES,
    RANGES,
    st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=4, max_size=4),
)
def test_enclosures_hold(
    formula: Any, x: tuple[float, float], y: tuple[float, float], places: Any
) -> None:
    program = Program()
    node = recorded(program, formula).node
    low, high = enclosed(program, node, {"x": x, "y": y})
    for at_x, at_y in [*places, (0.0, 0.0), (1.0, 1.0), (0.0, 1.0)]:
        point = {"x": _between(x, at_x), "y": _between(y, at_y)}
        value = truth(program, node, point)
        if value is not None:
            assert low <= value <= high, (point, value)


@pytest.mark.parametrize(
    ("function", "x", "expected"),
    [
        ("sin", (0.5, 2.0), 1.0),
        ("sin", (-2.0, -1.0), -1.0),
        ("cos", (-0.5, 0.7), 1.0),
        ("cos", (3.0, 3.5), -1.0),
    ],
)
def test_waves_reach_their_extremes_between_the_ends(
    function: str, x: tuple[float, float], expected: float
) -> None:
    program = Program()
    node = getattr(program.input("x"), function)().node
    low, high = enclosed(program, node, {"x": x})
    assert (high if expected > 0 else low) == expected


def _between(ends: tuple[float, float], share: float) -> float:
    return min(max(ends[0] + share * (ends[1] - ends[0]), ends[0]), ends[1])


@examples(200)
@given(FORMULAS, ENDS, ENDS)
def test_points_are_exact_up_to_rounding(formula: Any, x: float, y: float) -> None:
    """At a point every operation adds a relative 1e-14; what is wider must be ill-conditioned itself."""
    program = Program()
    node = recorded(program, formula).node
    value = truth(program, node, {"x": x, "y": y})
    assume(value is not None)
    # how much fifty digits change when the inputs change by 1e-13 says how ill-conditioned it is
    moved = [
        truth(program, node, {"x": x * (1 + a), "y": y * (1 + b)})
        for a, b in ((1e-13, -1e-13), (-1e-13, 1e-13))
    ]
    assume(all(v is not None for v in moved))
    assume(not program.needed([node]) or _tame(program, node, {"x": x, "y": y}))
    low, high = enclosed(program, node, {"x": (x, x), "y": (y, y)})
    assert low <= value <= high
    assert high - low <= 1e-8 * max(1.0, abs(float(value)))


def _tame(program: Program, output: int, point: Mapping[str, float]) -> bool:
    """Whether all intermediate values are of ordinary size and none is next to a jump, a pole or a root's end."""
    for node in program.needed([output]):
        value = truth(program, node, point)
        if value is None or not abs(value) < 1e3:
            return False
        op, a = Op(program.ops[node]), program.lhs[node]
        divisor = program.rhs[node] if op is Op.DIV else a
        if (
            op in (Op.DIV, Op.LOG, Op.SQRT, Op.SIGN)
            and abs(truth(program, divisor, point)) < 1e-2
        ):
            return False
        if op is Op.TAN and abs(mpmath.cos(truth(program, a, point))) < 1e-2:
            return False
    return True


@examples(200)
@given(FORMULAS, RANGES, RANGES, st.tuples(*[st.floats(0, 1)] * 4))
def test_narrower_inputs_give_narrower_enclosures(
    formula: Any,
    x: tuple[float, float],
    y: tuple[float, float],
    ends: tuple[float, float, float, float],
) -> None:
    program = Program()
    node = recorded(program, formula).node
    inner = {
        name: tuple(sorted((_between(whole, a), _between(whole, b))))
        for name, whole, a, b in (
            ("x", x, ends[0], ends[1]),
            ("y", y, ends[2], ends[3]),
        )
    }
    low, high = enclosed(program, node, {"x": x, "y": y})
    least, largest = enclosed(program, node, inner)  # type: ignore[arg-type]
    slack = 1e-11 * max(
        1.0,
        abs(low) if math.isfinite(low) else 1.0,
        abs(high) if math.isfinite(high) else 1.0,
    )
    assert least >= low - slack
    assert largest <= high + slack


CASES = [
    (Op.SIN, (0.0, 4.0), (math.sin(4.0), 1.0)),
    (Op.SIN, (-2.0, 0.5), (-1.0, math.sin(0.5))),
    (Op.SIN, (3.5, 12.0), (-1.0, 1.0)),
    (Op.COS, (-0.5, 1.0), (math.cos(1.0), 1.0)),
    (Op.COS, (3.0, 3.5), (-1.0, math.cos(3.5))),
    (Op.TAN, (-1.5, 1.2), (math.tan(-1.5), math.tan(1.2))),
    (Op.TAN, (1.5, 1.7), (-math.inf, math.inf)),
    (Op.TAN, (-10.0, 10.0), (-math.inf, math.inf)),
    (Op.LOG, (0.5, 2.0), (math.log(0.5), math.log(2.0))),
    (Op.LOG, (0.0, 2.0), (-math.inf, math.inf)),
    (Op.SQRT, (0.0, 4.0), (0.0, 2.0)),
    (Op.SQRT, (-1e-9, 4.0), (-math.inf, math.inf)),
    (Op.ABS, (-3.0, 2.0), (0.0, 3.0)),
    (Op.ABS, (-3.0, -2.0), (2.0, 3.0)),
    (Op.SIGN, (-1.0, 2.0), (-1.0, 1.0)),
    (Op.SIGN, (0.0, 2.0), (0.0, 1.0)),
    (Op.EXP, (-1.0, 1.0), (math.exp(-1), math.e)),
    (Op.TANH, (-1.0, 2.0), (math.tanh(-1.0), math.tanh(2.0))),
    (Op.ATAN, (-1.0, 1.0), (-math.pi / 4, math.pi / 4)),
]


@pytest.mark.parametrize(
    ("op", "given", "expected"),
    CASES,
    ids=lambda v: v.name if isinstance(v, Op) else str(v),
)
def test_functions(
    op: Op, given: tuple[float, float], expected: tuple[float, float]
) -> None:
    program = Program()
    node = program.function(op, program.input("x")).node
    np.testing.assert_allclose(
        enclosed(program, node, {"x": given}), expected, rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize(
    ("divisor", "expected"),
    [
        ((2.0, 4.0), (0.25, 1.0)),
        ((-4.0, -2.0), (-1.0, -0.25)),
        ((-1.0, 2.0), (-math.inf, math.inf)),
        ((0.0, 2.0), (-math.inf, math.inf)),
        ((0.0, 0.0), (-math.inf, math.inf)),
    ],
)
def test_divisions(divisor: tuple[float, float], expected: tuple[float, float]) -> None:
    program = Program()
    node = (program.input("x") / program.input("y")).node
    np.testing.assert_allclose(
        enclosed(program, node, {"x": (1.0, 2.0), "y": divisor}), expected, rtol=1e-12
    )


@pytest.mark.parametrize("x", [200.3, 1e4, -54321.5])
@pytest.mark.parametrize("op", [Op.SIN, Op.COS, Op.TAN])
def test_after_many_turns(op: Op, x: float) -> None:
    program = Program()
    node = program.function(op, program.input("x")).node
    low, high = enclosed(program, node, {"x": (x, x)})
    with mpmath.workdps(50):
        assert low <= TRUTH[op](mpmath.mpf(x)) <= high


def test_poles_between_neighbouring_numbers() -> None:
    """π/2 lies between two numbers, and its tangent is everything."""
    program = Program()
    node = program.function(Op.TAN, program.input("x")).node
    low, high = enclosed(
        program, node, {"x": (math.pi / 2, float(np.nextafter(math.pi / 2, 2)))}
    )
    assert (low, high) == (-math.inf, math.inf)


def test_beyond_the_largest_number() -> None:
    program = Program()
    x = program.input("x")
    huge = program.function(Op.EXP, x).node
    low, high = enclosed(program, huge, {"x": (700.0, 800.0)})
    assert low <= math.exp(700)
    assert high == math.inf
    low, high = enclosed(program, huge, {"x": (800.0, 900.0)})
    assert 0 < low < math.inf
    assert high == math.inf
    wave = (1 / x).sin().node
    assert enclosed(program, wave, {"x": (-1.0, 1.0)}) == (-1.0, 1.0)


def test_squares_are_not_negative() -> None:
    program = Program()
    x = program.input("x")
    np.testing.assert_allclose(
        enclosed(program, (x * x).node, {"x": (-2.0, 1.0)}), (0.0, 4.0), rtol=1e-12
    )


def test_many_intervals_at_once() -> None:
    program = Program()
    x, y = program.input("x"), program.input("y")
    low = np.linspace(-3, 3, 7)
    ranges = {
        x.node: (low[:, None], low[:, None] + 0.5),
        y.node: (np.array([0.0, 1.0]), np.array([0.5, 2.0])),
    }
    ((least, largest),) = interval_values(program, [(x.sin() * y).node], ranges)
    assert least.shape == largest.shape == (7, 2)
    for i in range(7):
        for j in range(2):
            one = {"x": (low[i], low[i] + 0.5), "y": ((0.0, 1.0)[j], (0.5, 2.0)[j])}
            assert (least[i, j], largest[i, j]) == enclosed(
                program, (x.sin() * y).node, one
            )


def test_missing_inputs() -> None:
    program = Program()
    x, y = program.input("x"), program.input("y")
    with pytest.raises(InputError, match="the range of 'y' is missing"):
        interval_values(
            program, [(x + y).node], {x.node: (np.array(0.0), np.array(1.0))}
        )


# -- smoothing ---------------------------------------------------------------------------------------------------------


def test_signs_and_absolute_values_become_gradual() -> None:
    program = Program()
    x, y = program.input("x"), program.input("y")
    outputs = [
        program.function(Op.SIGN, x - y).node,
        program.function(Op.ABS, x).node,
        (x.cos() * y).node,
    ]
    new, nodes = smoothed(program, outputs, 0.25)
    assert not {Op.SIGN, Op.ABS} & {Op(new.ops[n]) for n in new.needed(nodes)}
    for at in (-0.3, -0.01, 0.0, 0.2, 1.5):
        point = {"x": at, "y": 0.1}
        found = [float(truth(new, node, point)) for node in nodes]
        expected = [
            math.tanh((at - 0.1) / 0.25),
            at * math.tanh(at / 0.25),
            math.cos(at) * 0.1,
        ]
        np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-16)


@given(st.floats(-3, 3).map(lambda x: round(x, 6)), st.floats(1e-3, 0.5))
def test_how_far_smoothing_changes_values(at: float, width: float) -> None:
    """|sign x − tanh(x/w)| < 2 e^(−2|x|/w), and |x| loses at most 0.28 w."""
    program = Program()
    x = program.input("x")
    outputs = [program.function(op, x).node for op in (Op.SIGN, Op.ABS)]
    new, nodes = smoothed(program, outputs, width)
    sign, size = (truth(new, node, {"x": at}) for node in nodes)
    if at:
        assert (
            abs(sign - mpmath.sign(at)) <= 2 * mpmath.exp(-2 * abs(at) / width) + 1e-14
        )
    assert -1e-14 <= abs(at) - size <= 0.28 * width


def test_smooth_programs_stay_themselves() -> None:
    program = Program()
    node = (program.input("x").sin() * 2).node
    assert smoothed(program, [node], 0.1) == (program, [node])


@given(RANGES, RANGES, RANGES, st.sampled_from(["add", "subtract"]), st.booleans())
def test_turning_vectors_have_exact_bounds(
    angle: tuple[float, float],
    first: tuple[float, float],
    second: tuple[float, float],
    kind: str,
    swapped: bool,
) -> None:
    """a·cos(x) ± b·sin(x) reaches its bounds at ends of a and b: dense samples come near them and never beyond."""
    program = Program()
    x, a, b = (program.input(name) for name in ("x", "a", "b"))
    waves = (x.sin(), x.cos()) if swapped else (x.cos(), x.sin())
    node = getattr(program, kind)((a * waves[0]).node, (b * waves[1]).node)
    ranges = {
        scalar.node: tuple(np.array(end) for end in ends)
        for scalar, ends in ((x, angle), (a, first), (b, second))
    }
    ((low, high),) = interval_values(program, [node], ranges)
    places = np.linspace(*angle, 2001)
    sign = 1 if kind == "add" else -1
    one, two = (np.sin, np.cos) if swapped else (np.cos, np.sin)
    values = [p * one(places) + sign * q * two(places) for p in first for q in second]
    slack = 1e-12 + 1e-5 * (np.max(np.abs(first)) + np.max(np.abs(second)))
    assert low <= np.min(values) <= low + slack
    assert high - slack <= np.max(values) <= high
