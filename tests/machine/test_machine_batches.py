"""Batches: sizes, pieces, threads, parts of long programs, and where results are written change no number."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest

from echelon.algebra.program.function import Argument, Function
from echelon.algebra.program.tape import Program, Scalar
from echelon.compute.machine import kernel as kernel_module
from echelon.compute.machine.kernel import Kernel
from echelon.compute.machine.operations_text import Vector, lowered
from echelon.compute.machine.rows_text import Way, rows_of
from echelon.compute.machine.target import Target, host
from echelon.shared.errors import InputError
from support.selection import slow_unless
from support.small_kernels import (
    LANES,
    Fences,
    FloatArray,
    by_numpy,
    function,
    same_bits,
)

WIDTH = 11
"""Columns of a result that is written by way of an image if it is big; with 16 it is written directly."""
SAMPLES = 5000


def record(
    x: list[Scalar], v: list[Scalar], p: list[Scalar]
) -> dict[tuple[int, ...], Scalar]:
    """Some hundred operations of which many use results from far back; every fourth entry is zero."""
    s, c = x[0].sin(), x[1].cos()
    made = [
        s * c,
        s * v[0] + p[0],
        c - v[1],
        p[0] * p[1] * x[2],
        v[2] * v[2],
        x[0],
        p[1],
    ]
    for k in range(80):
        made.append((made[k] + made[-1] * s) * 0.5 - made[k // 2] * c)
    return {(k // WIDTH, k % WIDTH): made[-1 - k] for k in range(3 * WIDTH) if k % 4}


@pytest.fixture(scope="module", params=[WIDTH, 16])
def made(request: pytest.FixtureRequest) -> Function:
    return function(record, {"x": 3, "v": 3}, {"p": 2}, shape=(3, request.param))


@pytest.fixture(scope="module")
def values() -> dict[str, FloatArray]:
    rng = np.random.default_rng(1)
    return {
        "x": rng.uniform(-3, 3, (SAMPLES, 3)),
        "v": rng.normal(size=(SAMPLES, 3)),
        "p": np.array([0.3, -1.2]),
    }


@pytest.fixture(scope="module")
def expected(made: Function, values: dict[str, FloatArray]) -> FloatArray:
    return by_numpy(made, values)


def some(values: dict[str, FloatArray], chosen: slice) -> dict[str, FloatArray]:
    return {name: a if a.ndim == 1 else a[chosen] for name, a in values.items()}


def check(found: FloatArray, expected: FloatArray) -> None:
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=1e-12 * np.abs(expected).max()
    )


# -- sizes and places ----------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("any_size")
def test_any_number_of_samples(
    made: Function, values: dict[str, FloatArray], expected: FloatArray, target: Target
) -> None:
    """From none to more than three vectors; nothing is written before or after the result."""
    run = Kernel(made, target=target)
    whole, fences = run(values), Fences()
    check(whole, expected)
    for count in range(3 * target.lanes + 2):
        out = fences.array((count, *made.shape), count % 8)
        assert run(some(values, slice(count)), out) is out
        assert same_bits(out, whole[:count])
    fences.check()


@pytest.mark.parametrize("offset", range(8))
@pytest.mark.usefixtures("any_size")
def test_results_anywhere_in_memory(
    made: Function, values: dict[str, FloatArray], expected: FloatArray, offset: int
) -> None:
    fences = Fences()
    out = fences.array((200, *made.shape), offset)
    Kernel(made)(some(values, slice(200)), out)
    check(out, expected[:200])
    fences.check()


@pytest.mark.usefixtures("any_size")
def test_a_sample_does_not_depend_on_its_place(
    made: Function, values: dict[str, FloatArray], target: Target
) -> None:
    run = Kernel(made, target=target)
    whole = run(values)
    order = np.random.default_rng(2).permutation(SAMPLES)
    assert same_bits(
        run({**values, "x": values["x"][order], "v": values["v"][order]}), whole[order]
    )
    for first in range(2 * target.lanes):
        assert same_bits(
            run(some(values, slice(first, first + 5))), whole[first : first + 5]
        )


def test_bad_neighbours_change_nothing(
    made: Function, values: dict[str, FloatArray], target: Target
) -> None:
    """NaN, infinity and huge angles reach the results of their own sample only."""
    run, good = Kernel(made, target=target), some(values, slice(64))
    whole, bad = run(good), good["x"].copy()
    rows = np.arange(3, 64, 7)
    bad[rows, 0] = np.resize([np.nan, np.inf, 1e15, -np.inf], len(rows))
    found = run({**good, "x": bad})
    kept = np.setdiff1d(np.arange(64), rows)
    assert same_bits(found[kept], whole[kept])
    lost = np.isnan(found[rows]).any(axis=(1, 2))
    np.testing.assert_array_equal(lost, ~(bad[rows, 0] == 1e15))


# -- threads -------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("any_size")
def test_threads_change_nothing(
    made: Function, values: dict[str, FloatArray], monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[int] = []

    class Pool(ThreadPoolExecutor):
        def __init__(self, workers: int) -> None:
            started.append(workers)
            super().__init__(workers)

    monkeypatch.setattr(kernel_module, "_FEWEST", 64)
    monkeypatch.setattr(kernel_module, "ThreadPoolExecutor", Pool)
    run = Kernel(made)
    alone = run(values, threads=1)
    for threads in (2, 4, 7, None):
        assert same_bits(run(values, threads=threads), alone)
        odd = some(values, slice(1009))
        assert same_bits(run(odd, threads=threads), alone[:1009])
    assert started[:6] == [2, 2, 4, 4, 7, 7]


def test_small_batches_start_no_threads(
    made: Function, values: dict[str, FloatArray], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(kernel_module, "ThreadPoolExecutor")
    run = Kernel(made)
    run(values, threads=1)
    run(some(values, slice(500)), threads=8)


@pytest.mark.parametrize("threads", [0, -1])
def test_no_threads(
    made: Function, values: dict[str, FloatArray], threads: int
) -> None:
    out = np.full((SAMPLES, *made.shape), 7.0)
    with pytest.raises(InputError, match=f"threads is {threads}; expected at least 1"):
        Kernel(made)(values, out, threads)
    assert (out == 7).all()


def test_one_kernel_for_several_callers(
    made: Function, values: dict[str, FloatArray]
) -> None:
    """Calls at the same time do not disturb each other, the first ones included, which compile."""
    run = Kernel(made)

    def call(number: int) -> FloatArray:
        return run({**values, "p": np.array([number, -1.0])}, threads=1 + number % 3)

    with ThreadPoolExecutor(6) as pool:
        together = list(pool.map(call, range(24)))
    for number, found in enumerate(together):
        assert same_bits(found, call(number))


def test_repeated_calls(made: Function, values: dict[str, FloatArray]) -> None:
    """Results do not share memory, and an array may be used again."""
    run = Kernel(made)
    first = run(values)
    again = run(values)
    assert not np.may_share_memory(first, again)
    other = {**values, "p": np.array([5.0, 6.0])}
    run(other, again)
    assert same_bits(again, run(other))
    run(values, again)
    assert same_bits(again, first)


# -- long programs -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", slow_unless([3, 50], [1, 3, 7, 50, 1000]))
@pytest.mark.usefixtures("any_size")
def test_parts_change_nothing(
    made: Function,
    values: dict[str, FloatArray],
    expected: FloatArray,
    monkeypatch: pytest.MonkeyPatch,
    part: int,
) -> None:
    monkeypatch.setattr(
        kernel_module, "lowered", partial(lowered, longest=1, part=part)
    )
    check(Kernel(made)(values), expected)


def test_parts_hold_every_operation_once(made: Function) -> None:
    whole, cut = lowered(made), lowered(made, longest=10, part=7)
    assert len(whole.parts) == 1
    assert [len(part) for part in cut.parts[:-1]] == [7] * (len(cut.parts) - 1)
    assert sum(cut.parts, ()) == whole.parts[0]
    assert len(set(whole.parts[0])) == sum(made.operations().values())
    assert not whole.waiting
    # operands come from inputs, uniform values, constants, or operations before
    done: set[int] = set()
    for node in whole.parts[0]:
        operands = {
            made.program.lhs[node],
            made.program.rhs[node],
        } & made.varying - whole.columns.keys()
        assert operands <= done
        done.add(node)


def test_a_processor_without_fused_operations(
    made: Function, values: dict[str, FloatArray]
) -> None:
    """Also what a generic processor of this family can do gives the results."""
    known = host()
    if not known.triple.startswith("x86_64"):
        pytest.skip("only x86 processors come without them")
    plain = Target(known.triple, "x86-64", "", 2)
    check(Kernel(made, target=plain)(values), Kernel(made)(values))


def test_targets() -> None:
    for lanes in LANES:
        assert (host(lanes).lanes, host(lanes).cpu) == (lanes, host().cpu)
    with pytest.raises(
        InputError, match=r"this processor has no vectors of 3 doubles \(valid: 2"
    ):
        host(3)


@pytest.mark.parametrize("lanes", ["3", "wide", "-2"])
def test_width_from_the_environment(
    monkeypatch: pytest.MonkeyPatch, lanes: str
) -> None:
    monkeypatch.setenv("ECHELON_LANES", "2")
    assert host.__wrapped__().lanes == 2
    monkeypatch.setenv("ECHELON_LANES", lanes)
    with pytest.raises(
        InputError, match=f"this processor has no vectors of {lanes} doubles"
    ):
        host.__wrapped__()


def test_long_rows_are_not_copied_line_by_line_in_the_code() -> None:
    """The code of a big humanoid's regressor grows with its operations, not with the zeros of its rows."""
    program = Program()
    x = program.input("x")
    entries = {(0, 4 * k): ((x + k) * x).node for k in range(1, 1000)}
    argument = Argument("x", (x.node,), ("x",), ("1",))
    wide = Function(
        "wide", program, (argument,), entries, (("y",), tuple(map(str, range(40_001))))
    )
    places = [-1] * 40_001
    for entry, (_, column) in enumerate(entries):
        places[column] = entry
    rows = rows_of(lowered(wide), Vector(host().lanes), tuple(places), big=True)
    assert rows.way is Way.IMAGED
    assert rows.lines > 5000
    assert rows.block.streamed < 50
    values = np.linspace(-1, 1, 21)
    found = Kernel(wide)({"x": values[:, None]})
    expected = np.zeros((21, 1, 40_001))
    expected[:, 0, 4:4000:4] = (values[:, None] + np.arange(1, 1000)) * values[:, None]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
