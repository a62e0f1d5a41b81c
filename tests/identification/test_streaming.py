"""One pass over the logs: in constant memory, and with the same result however it is cut."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.compute.observe.triangle import upper_triangle
from echelon.identification.batches import BATCHES, Batcher, grouped, total
from echelon.identification.estimators.covariance import clustered, clustered_by
from echelon.identification.estimators.least_squares import irls
from echelon.identification.identifying import identify
from echelon.identification.logs.preparation.prepare import Preparation
from echelon.identification.passes_over_data import PassesOverData, ingest, size_of
from echelon.identification.result import Identification
from echelon.identification.rows import plan as model_plan
from echelon.identification.rows import rows as model_rows
from echelon.identification.rows.plan import LogPlan
from echelon.identification.rows.rows import prefetched
from echelon.shared.errors import InputError
from support.paths import TESTS
from support.pendulum_logs import PREPARATION, pendulum, write_log, write_logs
from support.selection import examples

_PEAK = """
import resource, sys
from pathlib import Path
from support.pendulum_logs import pendulum
from echelon.identification.identifying import identify
identify(pendulum(), sys.argv[1:], memory=0)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs")
    write_logs(path, 5)
    return path


@pytest.fixture(scope="module")
def plan() -> LogPlan:
    setup = pendulum()
    return LogPlan(ec.base_parameters(setup.mechanism), setup.columns, PREPARATION, 0.3)


def same(a: Identification, b: Identification, tolerance: float = 1e-9) -> None:
    """Both say the same to rounding: values, intervals and scores."""
    np.testing.assert_allclose(a.estimate.values, b.estimate.values, rtol=tolerance)
    np.testing.assert_allclose(a.estimate.std, b.estimate.std, rtol=1e3 * tolerance)
    assert len(a.validations) == len(b.validations)
    for one, other in zip(a.validations, b.validations, strict=True):
        assert (one.source, one.role) == (other.source, other.role)
        for x, y in zip(one.scores, other.scores, strict=True):
            assert x.rows == y.rows
            np.testing.assert_allclose(
                (x.rms, x.r2, x.bias),
                (y.rms, y.r2, y.bias),
                rtol=1e3 * tolerance,
                atol=1e-10,
            )


# -- memory ------------------------------------------------------------------------------------------------------------


def _peak(*logs: Path) -> float:
    """Megabytes that a process needs at most to identify from some logs."""
    run = subprocess.run(
        [sys.executable, "-c", _PEAK, *map(str, logs)],
        check=True,
        capture_output=True,
        text=True,
        cwd=TESTS,
    )
    return int(run.stdout.split()[-1]) / 1024


@pytest.mark.slow
@pytest.mark.skipif(
    sys.platform != "linux", reason="other systems count memory in other units"
)
def test_memory_does_not_grow_with_logs(tmp_path: Path) -> None:
    """Ten times as many files, or a file five times as long, add little: traces to look at, of bounded length."""
    few, many = tmp_path / "few", tmp_path / "many"
    write_logs(few, 4, samples=60_000)
    write_logs(many, 40, samples=60_000)
    assert _peak(many) < _peak(few) + 48  # the files hold 96 MB
    short, long = tmp_path / "short.parquet", tmp_path / "long.parquet"
    write_log(short, 600_000, seed=1)
    write_log(long, 3_000_000, seed=1)
    assert _peak(long) < _peak(short) + 24  # the file holds 120 MB


def test_rows_are_kept_within_bounds(plan: LogPlan, folder: Path) -> None:
    log = next(iter(sorted(folder.iterdir())))
    _, kept = ingest(plan, log, 4, memory=1 << 24)
    assert kept is not None
    size = sum(map(size_of, kept))
    assert 0 < size < 1 << 24
    assert ingest(plan, log, 4, memory=size)[1] is not None
    assert ingest(plan, log, 4, memory=size - 1)[1] is None


def test_rows_that_are_read_again_give_the_same(folder: Path) -> None:
    same(identify(pendulum(), [folder]), identify(pendulum(), [folder], memory=0))


def test_a_single_log_is_held_out_in_part(folder: Path) -> None:
    log = folder / "run0.parquet"
    kept = identify(pendulum(), [log])
    assert [found.role for found in kept.validations] == [
        "identification",
        "validation",
    ]
    same(kept, identify(pendulum(), [log], memory=0))


def test_the_truth_is_found(folder: Path, tmp_path: Path) -> None:
    truth = write_log(tmp_path / "log.parquet", 100, seed=0)
    found = identify(pendulum(), [folder]).estimate
    assert np.all(np.abs(found.values - truth) < 5 * found.std)


# -- cuts --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("window", [64, 300, 5000])
def test_windows_do_not_change_the_result(
    window: int, plan: LogPlan, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = folder / "run1.parquet"
    whole = plan.rows([log], "first").observation()
    monkeypatch.setattr(model_rows, "_WINDOW", window)
    monkeypatch.setattr(model_rows, "_REACHES", 0)
    cut = total(ingest(plan, log, 7)[0])
    assert cut.counts == whole.counts
    for R, expected in zip(cut.factors, whole.factors, strict=True):
        np.testing.assert_allclose(R, expected, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize(
    "preparation",
    [PREPARATION, PREPARATION.model_copy(update={"still": 0.0, "band": np.inf})],
)
@pytest.mark.parametrize("count", [1, 3, 40])
def test_batches_add_up_to_the_whole(
    count: int, preparation: Preparation, plan: LogPlan, folder: Path
) -> None:
    """Whether rows are formed or, without a filter, factored as they are."""
    plan, log = replace(plan, preparation=preparation), folder / "run2.parquet"
    batches = ingest(plan, log, count)[0]
    assert count <= len(batches) <= 2 * count
    whole = plan.rows([log], "first").observation()
    assert total(batches).counts == whole.counts
    for R, expected in zip(total(batches).factors, whole.factors, strict=True):
        np.testing.assert_allclose(R, expected, atol=1e-11 * np.abs(expected).max())
    assert [batch.start for batch in batches] == sorted(
        batch.start for batch in batches
    )
    assert sum(batch.observation.rows for batch in grouped(batches, 2)) == whole.rows


@pytest.mark.slow
def test_many_logs_make_as_many_batches_as_wanted(plan: LogPlan, folder: Path) -> None:
    logs = sorted(folder.iterdir())
    few, many = PassesOverData(plan, logs[:1]), PassesOverData(plan, logs * 10)
    assert BATCHES <= len(few.batches) <= 2 * BATCHES
    assert len(many.batches) == BATCHES
    assert many.observation.rows == 10 * sum(
        PassesOverData(plan, [log]).observation.rows for log in logs
    )


def test_intervals_from_factors_are_those_from_rows(
    plan: LogPlan, folder: Path
) -> None:
    rows = plan.rows([folder / "run3.parquet"], "first")
    (block,) = rows.blocks()
    start, stop = (float(block.times[0][k]) for k in (0, -1))
    batcher, length = Batcher(10), (stop - start) * (1 + 1e-9)
    batcher.begin(start, length)
    batcher.take(block, rows.layout)
    batches = batcher.batches()
    estimate = irls(total(batches), rows.units)
    expected = clustered(rows, estimate, seconds=length / 10)
    found = clustered_by(batches, rows.units, estimate)
    assert found.degrees == expected.degrees == 9
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-8)
    for name in ("inflation", "effective_rows"):
        assert found.diagnostics[name] == pytest.approx(expected.diagnostics[name])
    with pytest.raises(InputError, match="huber"):
        clustered_by(batches, rows.units, replace(estimate, method="huber"))
    with pytest.raises(InputError, match="within one batch"):
        clustered_by(batches[:1], rows.units, estimate)


# -- reading ahead -----------------------------------------------------------------------------------------------------


def test_items_come_in_order_and_errors_after_them() -> None:
    def items() -> Iterator[int]:
        yield from range(5)
        raise InputError("the file ends here")

    found: list[int] = []
    with pytest.raises(InputError, match="ends here"):
        found.extend(prefetched(items()))
    assert found == list(range(5))


def test_a_reader_stops_when_nobody_listens() -> None:
    made = []

    def items() -> Iterator[int]:
        for item in range(1000):
            made.append(item)
            yield item

    before = threading.active_count()
    reader = prefetched(items())
    assert next(reader) == 0
    reader.close()  # type: ignore[attr-defined]
    assert threading.active_count() == before
    assert len(made) < 10


# -- tall matrices -----------------------------------------------------------------------------------------------------


@examples(60)
@given(st.integers(0, 400), st.integers(0, 90), st.integers(0, 2**32 - 1))
def test_factors_of_parts_are_those_of_the_whole(
    rows: int, columns: int, seed: int
) -> None:
    matrix = np.random.default_rng(seed).standard_normal((rows, columns))
    found = upper_triangle(matrix[: rows // 3], matrix[rows // 3 :])
    assert found.shape == (columns, columns)
    assert not np.tril(found, -1).any()
    assert np.all(np.diagonal(found) >= 0)
    np.testing.assert_allclose(
        found.T @ found, matrix.T @ matrix, atol=1e-12 * max(rows, 1)
    )
    if 0 < columns <= rows:
        R = np.linalg.qr(matrix, mode="r")
        np.testing.assert_allclose(np.abs(found), np.abs(R), atol=1e-9)


def test_a_stretch_that_is_too_short_is_left_out(
    plan: LogPlan, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Never the whole log, unless there is nothing else."""
    (piece,) = model_plan.read_log(
        folder / "run1.parquet", plan.base.mechanism, plan.columns
    )
    (segment,) = piece.segments
    short = replace(
        segment, signals={name: values[:25] for name, values in segment.signals.items()}
    )
    pieces = [replace(piece, segments=(short, segment))]
    monkeypatch.setattr(model_plan, "read_log", lambda *_, **__: iter(pieces))
    assert len(list(plan.samples("run1"))) == 1
    pieces[0] = replace(piece, segments=(short,))
    with pytest.raises(InputError, match="an uninterrupted stretch has 25 samples"):
        list(plan.samples("run1"))
