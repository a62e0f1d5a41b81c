"""Arrays that go into kernels and come out: every layout gives the same numbers, and what is wrong is said."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from echelon.compute.machine.kernel import Kernel
from echelon.shared.errors import InputError
from support.small_kernels import FloatArray, function, same_bits

SAMPLES = 21


@pytest.fixture(scope="module")
def run() -> Kernel:
    return Kernel(
        function(
            lambda x, v, p: [x[0] * v[0] + p[0], x[2].sin() * p[1], v[1]],
            {"x": 3, "v": 2},
            {"p": 2},
        )
    )


@pytest.fixture
def values() -> dict[str, Any]:
    """Numbers that single precision holds."""
    rng = np.random.default_rng(1)
    whole = {
        "x": rng.integers(-9, 9, (SAMPLES, 3)),
        "v": rng.integers(-9, 9, (SAMPLES, 2)),
        "p": [2, -5],
    }
    return {name: np.array(array, dtype=float) for name, array in whole.items()}


def broadcast(array: FloatArray) -> FloatArray:
    return np.broadcast_to(array[0], array.shape)


def read_only(array: FloatArray) -> FloatArray:
    found = array.copy()
    found.flags.writeable = False
    return found


def misaligned(array: FloatArray) -> FloatArray:
    raw = np.zeros(array.nbytes + 1, dtype=np.uint8)
    found = raw[1:].view(np.float64).reshape(array.shape)
    found[...] = array
    return found


LAYOUTS: dict[str, Callable[[FloatArray], Any]] = {
    "lists": lambda a: a.tolist(),
    "tuples": lambda a: tuple(map(tuple, a.tolist())),
    "single precision": lambda a: a.astype(np.float32),
    "half precision": lambda a: a.astype(np.float16),
    "extended precision": lambda a: a.astype(np.longdouble),
    "integers": lambda a: a.astype(np.int32),
    "small integers": lambda a: a.astype(np.int8),
    "big-endian": lambda a: a.astype(">f8"),
    "Fortran order": np.asfortranarray,
    "part of wider rows": lambda a: np.hstack([a, a + 1])[:, : a.shape[1]],
    "every other column": lambda a: np.repeat(a, 2, axis=1)[:, ::2],
    "every third row": lambda a: np.repeat(a, 3, axis=0)[::3],
    "rows backwards": lambda a: a[::-1].copy()[::-1],
    "columns backwards": lambda a: a[:, ::-1].copy()[:, ::-1],
    "read-only": read_only,
    "misaligned": misaligned,
    "a subclass": lambda a: a.view(np.matrix),
}


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS.keys())
def test_layouts_of_inputs(
    run: Kernel, values: dict[str, Any], layout: Callable[[FloatArray], Any]
) -> None:
    expected = run(values)
    found = run({"x": layout(values["x"]), "v": layout(values["v"]), "p": values["p"]})
    assert type(found) is np.ndarray
    assert same_bits(found, expected)


def test_one_row_for_all_samples(run: Kernel, values: dict[str, Any]) -> None:
    x = broadcast(values["x"])
    assert x.strides[0] == 0
    assert same_bits(run({**values, "x": x}), run({**values, "x": x.copy()}))


def test_inputs_are_left_alone(run: Kernel, values: dict[str, Any]) -> None:
    before = {name: array.copy() for name, array in values.items()}
    run(values)
    assert all(same_bits(values[name], before[name]) for name in values)


def test_one_state(run: Kernel, values: dict[str, Any]) -> None:
    """One-dimensional columns are one sample."""
    found = run({"x": values["x"][3], "v": values["v"][3], "p": values["p"]})
    assert found.shape == (1, 3)
    assert same_bits(found, run(values)[3:4])


def test_no_samples(run: Kernel, values: dict[str, Any]) -> None:
    for threads in (None, 1, 3):
        assert run(
            {**values, "x": np.zeros((0, 3)), "v": np.zeros((0, 2))}, threads=threads
        ).shape == (0, 3)


WRONG: dict[str, tuple[str, Any, str]] = {
    "too few columns": (
        "x",
        np.zeros((SAMPLES, 2)),
        r"x has shape (21, 2); expected (samples, 3): x0, x1, x2",
    ),
    "one state too short": (
        "x",
        np.zeros(2),
        r"x has shape (2,); expected (samples, 3)",
    ),
    "a number": ("x", 1.0, r"x has shape (); expected (samples, 3)"),
    "masked": (
        "x",
        np.ma.masked_equal(np.zeros((SAMPLES, 3)), 0.0),
        "x has masked values; leave out samples",
    ),
    "three axes": (
        "x",
        np.zeros((SAMPLES, 1, 3)),
        r"x has shape (21, 1, 3); expected (samples, 3)",
    ),
    "transposed": (
        "x",
        np.zeros((3, SAMPLES)),
        r"x has shape (3, 21); expected (samples, 3)",
    ),
    "other samples": (
        "x",
        np.zeros((5, 3)),
        r"arguments have different numbers of samples: x 5, v 21",
    ),
    "one sample among many": (
        "x",
        np.zeros((1, 3)),
        r"different numbers of samples: x 1, v 21",
    ),
    "uniform per sample": (
        "p",
        np.zeros((SAMPLES, 2)),
        r"p has shape (21, 2); expected (2,): p0, p1",
    ),
    "uniform too long": ("p", np.zeros(3), r"p has shape (3,); expected (2,): p0, p1"),
    "complex": (
        "x",
        np.zeros((SAMPLES, 3), dtype=complex),
        r"x holds complex128 values; expected real numbers",
    ),
    "truth values": (
        "x",
        np.zeros((SAMPLES, 3), dtype=bool),
        r"x holds bool values; expected real numbers",
    ),
    "objects": (
        "x",
        np.zeros((SAMPLES, 3), dtype=object),
        r"x holds object values; expected real numbers",
    ),
    "text": ("x", [["1", "2", "3"]], r"x holds <U1 values; expected real numbers"),
    "None": ("x", None, r"x holds object values; expected real numbers"),
    "dates": (
        "x",
        np.zeros((SAMPLES, 3), dtype="M8[s]"),
        r"x holds datetime64[s] values; expected real numbers",
    ),
    "ragged rows": ("x", [[1, 2, 3], [1, 2]], r"x is not an array of numbers"),
    "uniform text": ("p", "ab", r"p holds <U2 values; expected real numbers"),
}


@pytest.mark.parametrize(("name", "value", "message"), WRONG.values(), ids=WRONG.keys())
def test_wrong_inputs(
    run: Kernel, values: dict[str, Any], name: str, value: Any, message: str
) -> None:
    out = np.full((SAMPLES, 3), 7.0)
    with pytest.raises(InputError, match=re.escape(message)):
        run({**values, name: value}, out)
    assert (out == 7).all()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("x", "x is missing; it holds x0, x1, x2"),
        ("p", "p is missing; it holds p0, p1"),
    ],
)
def test_missing_inputs(
    run: Kernel, values: dict[str, Any], name: str, message: str
) -> None:
    del values[name]
    with pytest.raises(InputError, match=message):
        run(values)


def test_long_lists_of_names_are_cut() -> None:
    wide = Kernel(function(lambda x: [x[0]], {"x": 30}))
    with pytest.raises(InputError, match=r"expected \(samples, 30\): x0, .*, x11, …$"):
        wide({"x": np.zeros((4, 3))})


# -- results -------------------------------------------------------------------------------------------------------


def test_results_are_written_where_they_are_wanted(
    run: Kernel, values: dict[str, Any]
) -> None:
    expected = run(values)
    space = np.full((3, SAMPLES, 3), 7.0)
    out = space[1]
    assert run(values, out) is out
    assert same_bits(space[1], expected)
    assert (space[[0, 2]] == 7).all()


def test_new_results_start_on_a_cache_line(run: Kernel, values: dict[str, Any]) -> None:
    found = run(values)
    assert found.ctypes.data % 64 == 0
    assert found.flags.c_contiguous
    assert found.flags.writeable


BAD_RESULTS: dict[str, tuple[Callable[[], Any], str]] = {
    "too short": (
        lambda: np.zeros((SAMPLES - 1, 3)),
        "out has shape (20, 3); expected (21, 3)",
    ),
    "too long": (
        lambda: np.zeros((SAMPLES + 1, 3)),
        "out has shape (22, 3); expected (21, 3)",
    ),
    "flat": (lambda: np.zeros(SAMPLES * 3), "out has shape (63,); expected (21, 3)"),
    "single precision": (
        lambda: np.zeros((SAMPLES, 3), dtype=np.float32),
        "out holds float32 values; expected float64",
    ),
    "integers": (
        lambda: np.zeros((SAMPLES, 3), dtype=np.int64),
        "out holds int64 values; expected float64",
    ),
    "big-endian": (
        lambda: np.zeros((SAMPLES, 3), dtype=">f8"),
        "out holds >f8 values; expected float64",
    ),
    "Fortran order": (
        lambda: np.zeros((SAMPLES, 3), order="F"),
        "out is not contiguous in C order",
    ),
    "with gaps": (
        lambda: np.zeros((SAMPLES, 5))[:, :3],
        "out is not contiguous in C order",
    ),
    "backwards": (
        lambda: np.zeros((SAMPLES, 3))[::-1],
        "out is not contiguous in C order",
    ),
    "misaligned": (
        lambda: misaligned(np.zeros((SAMPLES, 3))),
        "out is not contiguous in C order",
    ),
    "read-only": (lambda: read_only(np.zeros((SAMPLES, 3))), "out is read-only"),
    "a list": (lambda: [[0.0] * 3] * SAMPLES, "out is a list; expected a NumPy array"),
    "a number": (lambda: 0.0, "out is a float; expected a NumPy array"),
}


@pytest.mark.parametrize(
    ("make", "message"), BAD_RESULTS.values(), ids=BAD_RESULTS.keys()
)
def test_unusable_results(
    run: Kernel, values: dict[str, Any], make: Callable[[], Any], message: str
) -> None:
    out = make()
    with pytest.raises(InputError, match=re.escape(message)):
        run(values, out)
    assert not np.any(out)


def test_results_over_inputs(run: Kernel, values: dict[str, Any]) -> None:
    """Writing over what is still to be read is refused, also over a part of it; copied inputs do not matter."""
    space = np.zeros(3 * SAMPLES + 60)
    for first in (0, 60):
        x = space[first : first + 3 * SAMPLES].reshape(SAMPLES, 3)
        x[...] = values["x"]
        out = space[:63].reshape(SAMPLES, 3)
        with pytest.raises(InputError, match="out overlaps an input"):
            run({**values, "x": x}, out)
        assert same_bits(x, values["x"])
    expected = run(values)
    shared = values["x"].astype(">f8").view(np.float64)
    assert same_bits(run({**values, "x": shared.view(">f8")}, shared), expected)
