"""Intervals of simulated robots' base parameters cover the true ones as often as they say, over hundreds of seeds.

MuJoCo moves a robot once; what differs from seed to seed is noise.  With noise in the outputs only, the regressor is
the same for all seeds, so its rows are factored once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import numpy.typing as npt
import pytest
from scipy.linalg import qr
from scipy.signal import lfilter
from scipy.stats import binom

from echelon.base.model import BaseModel
from echelon.compute.observe.observation import Layout, Observation
from echelon.identification.estimators.covariance import clustered
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.estimators.least_squares import irls, ols
from echelon.identification.identifying import identify
from echelon.identification.logs.preparation.prepare import Preparation, prepare
from echelon.identification.logs.recording import Segment
from echelon.identification.rows.rows import ModelRows
from support.observation_rows import ArrayRows
from support.selection import slow_unless
from support.simulated_robots import System
from support.simulated_systems import SYSTEMS, motion_of

Floats = npt.NDArray[np.float64]
Hits = npt.NDArray[np.bool_]

SEEDS = 200
LEVELS = (0.8, 0.95, 0.99)
MEMORY = 0.9
"""Correlation of neighbouring samples of coloured noise, of which 19 say as much of a slow motion as one white one."""


def _only_arms() -> System:
    """The floating robot without the forces at its base, from which ten parameters fewer can be seen."""
    full = SYSTEMS["floating"]
    arms = ("left1", "left2", "right1", "right2")
    setup = {**full.setup, "outputs": [{"joint": name} for name in arms]}
    return replace(
        full,
        name="floating, joint torques",
        setup=setup,
        noise=full.noise[6:],
        measure=lambda _, data: np.array(data.qfrc_inverse[6:]),
    )


ALL = {**SYSTEMS, "floating, joint torques": _only_arms()}


@dataclass(frozen=True)
class Trial:
    """Rows of an exact motion, factored, and the truth."""

    layout: Layout
    units: tuple[str, ...]
    matrices: tuple[Floats, ...]
    exact: tuple[Floats, ...]
    times: tuple[Floats, ...]
    factors: tuple[tuple[Floats, Floats], ...]
    noise: Floats
    truth: Floats

    def observation(self, errors: list[Floats]) -> Observation:
        """R-factors of the rows with these errors of the outputs, as a QR of [W y] would give them."""
        made = []
        for (Q, R), y, error in zip(self.factors, self.exact, errors, strict=True):
            measured, n = y + error, len(R)
            factor = np.zeros((n + 1, n + 1))
            factor[:n, :n], factor[:n, n] = R, Q.T @ measured
            factor[n, n] = np.linalg.norm(measured - Q @ factor[:n, n])
            made.append(factor)
        return Observation(self.layout, tuple(made), tuple(len(y) for y in self.exact))

    def rows(self, errors: list[Floats]) -> ArrayRows:
        """The rows themselves."""
        return ArrayRows(
            self.matrices,
            [y + error for y, error in zip(self.exact, errors, strict=True)],
            columns=self.layout.columns,
            times=self.times,
            parameters=self.layout.parameters,
            outputs=self.layout.outputs,
            units=self.units,
        )

    def white(self, seed: int) -> list[Floats]:
        """Errors of the outputs, each with a deviation of its own."""
        rng = np.random.default_rng(seed)
        return [
            s * rng.standard_normal(len(y))
            for s, y in zip(self.noise, self.exact, strict=True)
        ]

    def coloured(self, seed: int) -> list[Floats]:
        """Errors that resemble their neighbours."""
        found = []
        for error in self.white(seed):
            start = [MEMORY * error[0] / np.sqrt(1 - MEMORY**2)]
            found.append(
                lfilter([np.sqrt(1 - MEMORY**2)], [1, -MEMORY], error, zi=start)[0]
            )
        return found


@cache
def model_of(name: str) -> tuple[BaseModel, Floats]:
    """The base model of a system and its true base parameters."""
    with TemporaryDirectory() as folder:
        base, standard = ALL[name].truth(Path(folder))
    return base, base.values(standard)


@cache
def trial(name: str) -> Trial:
    """A system's rows, of about two thousand samples."""
    system, (base, truth) = ALL[name], model_of(name)
    motion = motion_of(system)
    motion = motion.every(max(1, len(motion.time) // 2000))
    rows = ModelRows.of(base, [system.samples(motion)])
    blocks = list(rows.blocks())
    stacked = [
        [
            np.concatenate([getattr(block, part)[i] for block in blocks])
            for i in range(len(rows.layout.outputs))
        ]
        for part in ("matrices", "y", "times")
    ]
    matrices, exact, times = (tuple(some) for some in stacked)
    factors = tuple(qr(matrix, mode="economic") for matrix in matrices)
    return Trial(
        rows.layout,
        rows.units,
        matrices,
        exact,
        times,
        factors,
        np.array(system.noise),
        truth,
    )


def hits(estimates: Iterator[Estimate], truth: Floats, level: float = 0.95) -> Hits:
    """For each seed and parameter whether the interval holds the truth."""
    found = []
    for estimate in estimates:
        low, high = estimate.interval(level).T
        found.append((low <= truth) & (truth <= high))
    return np.array(found)


def assert_nominal(found: Hits, level: float, slack: float) -> None:
    """Each parameter is covered as often as the level would, but for one case in ten thousand, and all together are.

    Parameters of one fit are correlated, seeds are not: the error of the overall rate is that of a mean over seeds.
    """
    low, high = binom.interval(1 - 1e-4, len(found), level)
    counts = found.sum(axis=0)
    assert ((low <= counts) & (counts <= high)).all(), counts / len(found)
    rates = found.mean(axis=1)
    assert abs(rates.mean() - level) < slack
    assert abs(rates.mean() - level) < 4 * rates.std() / np.sqrt(len(rates))


# -- white noise -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", slow_unless(["arm"], ALL))
@pytest.mark.slow
def test_classical_intervals_cover(name: str) -> None:
    data = trial(name)
    estimates = [
        irls(data.observation(data.white(seed)), data.units) for seed in range(SEEDS)
    ]
    for level in LEVELS:
        assert_nominal(
            hits(iter(estimates), data.truth, level),
            level,
            0.02 if level < 0.9 else 0.01,
        )
    # not one by one: (ζ̂ − ζ)ᵀ C⁻¹ (ζ̂ − ζ) is on average the number of parameters
    errors = np.array([estimate.values - data.truth for estimate in estimates])
    scale = np.median([estimate.std for estimate in estimates], axis=0)
    squares = [
        e
        / scale
        @ np.linalg.solve(estimate.covariance / np.outer(scale, scale), e / scale)
        for e, estimate in zip(errors, estimates, strict=True)
    ]
    n = len(data.truth)
    assert np.mean(squares) == pytest.approx(
        n, abs=4 * np.sqrt(2 * n / SEEDS) + 0.01 * n
    )
    # neither the estimates nor the noise are off on average
    assert np.abs(errors.mean(axis=0) / errors.std(axis=0) * np.sqrt(SEEDS)).max() < 4.5
    noise = np.array([estimate.noise for estimate in estimates])
    assert np.abs(np.mean(noise**2, axis=0) / data.noise**2 - 1).max() < 0.01


def test_factors_are_those_of_the_rows() -> None:
    data = trial("arm")
    errors = data.white(3)
    one, other = (
        irls(some, data.units)
        for some in (data.observation(errors), data.rows(errors).observation())
    )
    np.testing.assert_allclose(one.values, other.values, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(one.std, other.std, rtol=1e-8)


def test_ten_parameters_fewer_without_the_base() -> None:
    assert (
        len(trial("floating").truth) - len(trial("floating, joint torques").truth) == 10
    )


def test_one_noise_for_outputs_of_several_units_does_not_cover() -> None:
    """Newtons and newton metres do not have the same noise, which is what textbook least squares takes for granted."""
    data = trial("wrist sensor")
    found = hits(
        (ols(data.observation(data.white(seed)), data.units) for seed in range(SEEDS)),
        data.truth,
    )
    rates = found.mean(axis=0)
    assert rates.min() < 0.9
    assert np.median(rates) > 0.99


# -- noise with a memory -----------------------------------------------------------------------------------------------


def batched(
    data: Trial, noise: Callable[[int], list[Floats]], seeds: int
) -> Iterator[Estimate]:
    for seed in range(seeds):
        errors = noise(seed)
        yield clustered(data.rows(errors), irls(data.observation(errors), data.units))


@pytest.mark.slow
def test_classical_intervals_are_too_narrow_for_noise_with_a_memory() -> None:
    data = trial("arm")
    found = hits(
        (
            irls(data.observation(data.coloured(seed)), data.units)
            for seed in range(200)
        ),
        data.truth,
    )
    assert found.mean() < 0.8


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_intervals_from_batches_cover_white_noise(name: str) -> None:
    """A little too often rather than too rarely, since each batch is left out in turn."""
    data = trial(name)
    found = hits(batched(data, data.white, SEEDS), data.truth)
    assert 0.94 < found.mean() < 0.985
    assert found.mean(axis=0).min() > binom.ppf(1e-4, SEEDS, 0.95) / SEEDS


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_intervals_from_batches_cover_noise_with_a_memory(name: str) -> None:
    """Forty batches of five memories each do not know all of the variance, but nearly."""
    data = trial(name)
    found = hits(batched(data, data.coloured, SEEDS), data.truth)
    assert 0.92 < found.mean() < 0.98
    assert found.mean(axis=0).min() > binom.ppf(1e-4, SEEDS, 0.92) / SEEDS


# -- noise in the positions as well ------------------------------------------------------------------------------------


def prepared(
    system: System, base: BaseModel, seed: int, blur: float, preparation: Preparation
) -> ModelRows:
    """Rows of a noisy log that holds positions and outputs only, differentiated and filtered."""
    motion, rng = motion_of(system), np.random.default_rng(seed)
    exact = system.samples(motion)
    y = motion.y + np.array(system.noise) * rng.standard_normal(motion.y.shape)
    q = exact.q + blur * rng.standard_normal(exact.q.shape)
    segment = Segment(system.name, 0.0, exact.rate, {"q": q, "y": y})
    return ModelRows.of(base, [prepare(segment, preparation, base.mechanism)])


def from_positions(name: str, blur: float, seeds: int = SEEDS) -> Hits:
    """Whether intervals cover when states are derived from noisy positions."""
    system, (base, truth) = ALL[name], model_of(name)
    still = system.setup.get("preparation", {}).get("still", 0.0)
    preparation = Preparation(band=4.0, measured=(), still=still, delays={})
    rows = (prepared(system, base, seed, blur, preparation) for seed in range(seeds))
    return hits((irls(some.observation(), some.units) for some in rows), truth)


@pytest.mark.slow
@pytest.mark.parametrize("name", SYSTEMS)
def test_intervals_cover_with_a_little_noise_in_the_positions(name: str) -> None:
    """As much as an encoder of 18 bits has; the rows that a filter keeps are a little alike, so in 94 % of cases."""
    found = from_positions(name, 1e-5)
    rates = found.mean(axis=1)
    assert abs(rates.mean() - 0.94) < 4 * rates.std() / np.sqrt(len(rates))
    assert found.mean(axis=0).min() > binom.ppf(1e-4, SEEDS, 0.94) / SEEDS


@pytest.mark.slow
def test_much_noise_in_the_positions_biases() -> None:
    """Derivatives of noisy positions disturb the columns, which biases; a third of the noise biases little."""
    assert from_positions("wrist sensor", 3e-2, 20).mean() < 0.7
    assert from_positions("wrist sensor", 1e-2, 20).mean() > 0.85


# -- from files to results ---------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", SYSTEMS)
def test_the_whole_way_from_a_log_covers(name: str, tmp_path: Path) -> None:
    """With every choice left to the pipeline: filters, decimation, batches; the last part of the log is held out."""
    system, (_, truth) = SYSTEMS[name], model_of(name)
    setup = system.load(tmp_path)
    setup = setup.with_settings(physical=False, essential="none")
    motion, mechanism = motion_of(system), setup.mechanism
    logs = (
        system.log(motion, tmp_path / f"run{seed}", mechanism, seed)
        for seed in range(25)
    )
    rates = hits((identify(setup, [log]).estimate for log in logs), truth).mean(axis=1)
    # batches that are left out in turn err on the safe side, most where data are poor as in the five-bar's small range
    assert rates.mean() > 0.94 - 4 * rates.std() / np.sqrt(len(rates))
    assert 0.92 < rates.mean() < 0.995
