"""Every operation of a program, done by a kernel, against NumPy; circular functions against ball arithmetic."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from fractions import Fraction

import flint
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echelon.algebra.program.function import Function
from echelon.algebra.program.operations import FUNCTIONS, Op
from echelon.algebra.program.tape import Scalar
from echelon.compute.machine.kernel import Kernel
from echelon.compute.machine.operations_text import LARGEST_ANGLE
from echelon.compute.machine.target import Target, host
from support.selection import examples
from support.small_kernels import LANES, FloatArray, by_numpy, function, same_bits

SPECIAL = np.array(
    [0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 5e-324, 1e-200, 1e200, np.inf, -np.inf, np.nan]
)
PAIRS = np.array(list(itertools.product(SPECIAL, SPECIAL)))
NUMBERS = np.concatenate([SPECIAL, np.random.default_rng(1).normal(0, 3, 100)])[:, None]

UNARY: dict[Op, Callable[[Scalar], Scalar]] = {
    op: lambda x, op=op: x.program.function(op, x) for op in FUNCTIONS
}
UNARY[Op.NEG] = lambda x: -x
EXACT = (Op.NEG, Op.SQRT, Op.ABS, Op.SIGN)
"""Functions whose results are rounded correctly everywhere."""


@pytest.mark.parametrize("op", UNARY, ids=lambda op: op.name)
@pytest.mark.parametrize("uniform", [False, True], ids=["varying", "uniform"])
@pytest.mark.filterwarnings(
    "ignore:invalid value", "ignore:divide by zero", "ignore:overflow"
)
def test_unary(op: Op, uniform: bool, target: Target) -> None:
    """Also of uniform arguments, whose functions are computed once for all samples."""
    if uniform:
        made = function(lambda _, x: [UNARY[op](x[0])], {"free": 0}, {"x": 1})
        run = Kernel(made, target=target)
        rows = [{"free": np.zeros((1, 0)), "x": row} for row in NUMBERS]
        found, expected = (
            np.concatenate([f(values) for values in rows])
            for f in (run, lambda v: by_numpy(made, v))
        )
    else:
        made = function(lambda x: [UNARY[op](x[0])], {"x": 1})
        found, expected = (
            Kernel(made, target=target)({"x": NUMBERS}),
            by_numpy(made, {"x": NUMBERS}),
        )
    if op in EXACT:
        np.testing.assert_array_equal(found, expected)
    else:
        np.testing.assert_array_max_ulp(found, expected, 4)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))


def test_sign_and_absolute_value_at_zero(target: Target) -> None:
    made = function(lambda x: [x[0].sign(), abs(x[0]), -x[0]], {"x": 1})
    found = Kernel(made, target=target)({"x": [[0.0], [-0.0], [np.nan]]})
    assert (found[:2, 0] == 0).all()
    assert not np.signbit(found[:2, 1]).any()
    assert np.signbit(found[:2, 2]).tolist() == [True, False]
    assert np.isnan(found[2]).all()


BINARY: dict[str, Callable[[Scalar, Scalar], Scalar]] = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b,
}


@pytest.mark.parametrize("name", BINARY)
@pytest.mark.filterwarnings(
    "ignore:invalid value", "ignore:divide by zero", "ignore:overflow"
)
def test_binary(name: str, target: Target) -> None:
    """Operands are two columns, a column and a uniform value on either side, or a column and a constant."""
    made = function(lambda x: [BINARY[name](x[0], x[1])], {"x": 2})
    assert same_bits(
        Kernel(made, target=target)({"x": PAIRS}), by_numpy(made, {"x": PAIRS})
    )
    op = BINARY[name]
    mixed = function(
        lambda x, p: [op(x[0], p[0]), op(p[0], x[0]), op(x[0], 3), op(3, x[0])],
        {"x": 1},
        {"p": 1},
    )
    run = Kernel(mixed, target=target)
    for value in SPECIAL:
        values = {"x": NUMBERS, "p": [value]}
        assert same_bits(run(values), by_numpy(mixed, values))


def test_constants_are_rounded_once(target: Target) -> None:
    """Exact constants that no double holds."""
    exact = [
        Fraction(1, 3),
        Fraction("0.1"),
        Fraction("1e-30"),
        Fraction("123456789.123456789123456789"),
        2**70 + 1,
    ]
    made = function(lambda x: [x[0] * value for value in exact], {"x": 1})
    assert Kernel(made, target=target)({"x": [1.0]}).tolist() == [
        list(map(float, exact))
    ]


STEPS: dict[str, Callable[[Scalar, Scalar], Scalar]] = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply by a sine": lambda a, b: a * b.sin(),
    "negate": lambda a, _: -a,
    "cosine": lambda a, _: a.cos(),
    "absolute value": lambda a, _: abs(a),
}


def programs(operations: int) -> st.SearchStrategy[Function]:
    """Random programs on three columns and two uniform values; each operation may use all earlier results."""
    steps = st.tuples(
        st.sampled_from(sorted(STEPS)), st.integers(0, 10**6), st.integers(0, 10**6)
    )

    def build(chosen: list[tuple[str, int, int]]) -> Function:
        def record(x: list[Scalar], p: list[Scalar]) -> list[Scalar]:
            made = [*x, *p, x[0].program.constant(2)]
            for step, i, j in chosen:
                made.append(STEPS[step](made[i % len(made)], made[j % len(made)]))
            return made[:: max(1, len(made) // 17)]

        return function(record, {"x": 3}, {"p": 2})

    return st.lists(steps, min_size=1, max_size=operations).map(build)


@examples(25)
@given(programs(40), st.sampled_from(LANES))
def test_random_programs(made: Function, lanes: int) -> None:
    rng = np.random.default_rng(3)
    values = {"x": rng.uniform(-2, 2, (11, 3)), "p": rng.uniform(-2, 2, 2)}
    expected = by_numpy(made, values)
    scale = 1 + np.abs(expected).max()
    np.testing.assert_allclose(
        Kernel(made, target=host(lanes))(values), expected, rtol=0, atol=1e-11 * scale
    )


# -- forms of results ----------------------------------------------------------------------------------------------


def sample_values(made: Function, samples: int) -> dict[str, FloatArray]:
    rng = np.random.default_rng(5)
    return {
        a.name: rng.normal(size=len(a) if a.uniform else (samples, len(a)))
        for a in made.arguments
    }


def tensor(x: list[Scalar], p: list[Scalar]) -> dict[tuple[int, ...], Scalar]:
    """Some entries of an array with four axes, in an order of their own."""
    return {
        (1, 0, 2, 1): x[0] * p[0],
        (0, 1, 0, 0): x[1],
        (1, 1, 2, 1): x[0] * p[0],
        (0, 0, 1, 1): p[1],
    }


FORMS: dict[str, Function] = {
    "inputs": function(lambda x: [x[2], x[0], x[1], x[0]], {"x": 3}),
    "constants": function(
        lambda x: [x[0].program.constant(k) for k in (3, -1, 0)], {"x": 2}
    ),
    "uniform values": function(
        lambda _, p: [p[0], p[0] * p[1], p[1].sin(), p[0]], {"x": 1}, {"p": 2}
    ),
    "one node many times": function(lambda x: [x[0] * x[1]] * 19, {"x": 2}),
    "all kinds": function(
        lambda x, p: [x[0], p[0], x[0] + p[0], x[0].program.one, x[0] + p[0]],
        {"x": 1},
        {"p": 1},
    ),
    "no entries": function(lambda _: {}, {"x": 2}, shape=(3, 2)),
    "no results": function(lambda _: {}, {"x": 2}, shape=(0,)),
    "a scalar": function(lambda x: {(): x[0] * x[1]}, {"x": 2}, shape=()),
    "four axes": function(tensor, {"x": 2}, {"p": 2}, shape=(2, 2, 3, 2)),
    "zeros first": function(
        lambda x: {(0, 21): x[0] + 1, (1, 22): x[0]}, {"x": 1}, shape=(2, 23)
    ),
    "zeros last": function(
        lambda x: {(0, 0): x[0] + 1, (1, 1): x[0]}, {"x": 1}, shape=(2, 23)
    ),
    "one of many columns": function(
        lambda x: {(50,): x[0] * 2}, {"x": 1}, shape=(101,)
    ),
    "no columns": function(lambda _, p: [p[0] + 1, p[1]], {"x": 0}, {"p": 2}),
    "no varying arguments": function(lambda p: [p[0] + 1, p[1]], {}, {"p": 2}),
    "no arguments at all": function(lambda: {}, {}, shape=(2,)),
}


@pytest.mark.parametrize("sparse", [False, True], ids=["dense", "sparse"])
@pytest.mark.parametrize("made", FORMS.values(), ids=FORMS.keys())
@pytest.mark.usefixtures("any_size")
def test_forms_of_results(made: Function, sparse: bool, target: Target) -> None:
    values = sample_values(made, 21)
    expected = by_numpy(made, values)
    if sparse:
        columns = [expected[:, *index] for index in made.entries]
        expected = np.array(columns).reshape(len(columns), len(expected)).T.copy()
    run = Kernel(made, sparse=sparse, target=target)
    assert run.shape == expected.shape[1:]
    # a new array and one that holds other numbers
    for out in (None, np.full(expected.shape, 7.0)):
        np.testing.assert_allclose(run(values, out), expected, rtol=1e-15)


@pytest.mark.parametrize("width", [1, 3, 4, 7, 8, 16, 19])
@pytest.mark.usefixtures("any_size")
def test_rows_of_every_width(width: int, target: Target) -> None:
    """Dense rows, and rows with a structural zero at every place but one."""
    dense = function(lambda x: [x[0] * k for k in range(1, width + 1)], {"x": 1})
    x = np.arange(1.0, 22.0)[:, None]
    np.testing.assert_array_equal(
        Kernel(dense, target=target)({"x": x}), x * np.arange(1, width + 1)
    )
    place = width // 2
    single = function(lambda x: {(place,): x[0] * x[0]}, {"x": 1}, shape=(width,))
    np.testing.assert_array_equal(
        Kernel(single, target=target)({"x": x}), x * x * (np.arange(width) == place)
    )


FUNCTIONS = {"sin": flint.arb.sin, "cos": flint.arb.cos, "tan": flint.arb.tan}
REACHED = {"sin": 1.3, "cos": 1.3, "tan": 2.8}
"""Largest errors found over the angles of this file, rounded up; 750 000 others reached 1.48, 1.43 and 2.77."""


@pytest.fixture(scope="module", params=LANES)
def kernel(request: pytest.FixtureRequest) -> Kernel:
    made = function(lambda x: [x[0].sin(), x[0].cos(), x[0].tan()], {"x": 1})
    return Kernel(made, target=host(request.param))


def column(kernel: Kernel, angles: FloatArray) -> FloatArray:
    return kernel({"x": angles[:, None]}).T


def errors(
    angles: FloatArray, values: FloatArray, exact: Callable[[flint.arb], flint.arb]
) -> FloatArray:
    """Distance from the exact values in units in the last place."""
    found = []
    with flint.ctx.workprec(1300):  # 1e300 has a thousand bits before the point
        for angle, value in zip(angles.tolist(), values.tolist(), strict=True):
            truth = exact(flint.arb(angle))
            found.append(float(abs(truth - value)) / np.spacing(abs(float(truth))))
    return np.array(found)


def nearest_to_quarter_turns() -> Iterator[float]:
    """The doubles that come closest to multiples of π/2: best rational approximations, for every binary exponent."""
    with flint.ctx.workprec(400):
        quarter = Fraction(int((flint.arb.pi() * 2**300).floor().unique_fmpz()), 2**301)
    for exponent in range(-52, -22):
        step = Fraction(2) ** exponent
        ratio, (before, last) = step / quarter, (1, 0)
        while last < 2**53:
            whole = ratio.numerator // ratio.denominator
            before, last = last, whole * last + before
            if 0 < last < 2**53 and last * step < LARGEST_ANGLE:
                yield float(last * step)
            ratio = 1 / (ratio - whole)


def quarter_turns() -> FloatArray:
    turns = np.concatenate(
        [np.arange(1000), np.random.default_rng(1).integers(0, 2**29, 2000)]
    ) * (np.pi / 2)
    return np.concatenate(
        [turns, np.nextafter(turns, np.inf), np.nextafter(turns, -np.inf)]
    )


def uniform(size: float, count: int = 2000) -> FloatArray:
    return np.random.default_rng(2).uniform(-size, size, count)


ANGLES = {
    "robots": uniform(4),
    "many turns": uniform(1e3),
    "odd eighths": (np.arange(-1000, 1000) + 0.5) * (np.pi / 2),
    "up to the limit": np.append(
        uniform(LARGEST_ANGLE), np.nextafter(LARGEST_ANGLE, 0)
    ),
    "multiples of a quarter turn": quarter_turns(),
    "worst cases": np.array(list(nearest_to_quarter_turns())),
    "tiny": 10.0 ** np.random.default_rng(3).uniform(-323, -1, 2000),
    "beyond": np.append(
        10.0 ** np.random.default_rng(4).uniform(9, 308, 300), [1e9, 1e12, 1e22, 1e300]
    ),
}


@pytest.mark.parametrize("angles", ANGLES.values(), ids=ANGLES.keys())
def test_errors_in_the_last_place(kernel: Kernel, angles: FloatArray) -> None:
    for values, (name, exact) in zip(
        column(kernel, angles), FUNCTIONS.items(), strict=True
    ):
        assert errors(angles, values, exact).max() < REACHED[name], name


def test_worst_cases_are_bad() -> None:
    """Their sine or cosine is nine digits below the spacing of doubles there."""
    angles = ANGLES["worst cases"]
    assert len(angles) > 300
    smallest = np.minimum(np.abs(np.sin(angles)), np.abs(np.cos(angles)))
    assert (smallest / angles).min() < 1e-24


def test_zero_keeps_its_sign(kernel: Kernel) -> None:
    zeros = np.array([0.0, -0.0])
    assert same_bits(column(kernel, zeros), np.stack([zeros, [1.0, 1.0], zeros]))


def test_symmetry_is_exact(kernel: Kernel) -> None:
    angles = np.concatenate(list(ANGLES.values()))
    signs = np.array([[-1.0], [1.0], [-1.0]])
    assert same_bits(column(kernel, -angles), signs * column(kernel, angles))


@pytest.mark.parametrize("bad", [np.inf, -np.inf, np.nan, -np.nan])
def test_what_is_no_angle_gives_nan(kernel: Kernel, bad: float) -> None:
    assert np.isnan(column(kernel, np.array([bad]))).all()


def test_every_lane_gives_the_same(kernel: Kernel) -> None:
    angles = np.concatenate([a[:8] for a in ANGLES.values()] + [[np.nan]])
    alone = np.stack(
        [column(kernel, np.array([angle]))[:, 0] for angle in angles], axis=1
    )
    for shift in range(kernel.target.lanes):
        moved = np.roll(angles, shift)
        assert same_bits(column(kernel, moved), np.roll(alone, shift, axis=1))


def test_all_widths_give_the_same() -> None:
    made = function(lambda x: [x[0].sin(), x[0].cos()], {"x": 1})
    angles = np.concatenate(list(ANGLES.values()))
    first, *others = (
        column(Kernel(made, target=host(lanes)), angles) for lanes in LANES
    )
    assert all(same_bits(first, other) for other in others)
