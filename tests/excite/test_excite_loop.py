"""The loop closed: a trajectory is designed, a robot runs it in MuJoCo, and what its log shows is what was promised."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import digamma, polygamma
from scipy.stats import chi2

import echelon as ec
from echelon.excite.problem.trajectory import Trajectory
from support.excited_arm import (
    ARM,
    EFFORT,
    ENCODER,
    NOISE,
    POSITION,
    SEEDS,
    UNMODELLED,
    VELOCITY,
    Floats,
    excited,
    followed,
    identified,
    known,
    log_det,
    others,
    random_motion,
    rows,
    scaled_condition,
    sines,
)
from support.paths import ROOT
from support.selection import slow_unless

# -- what was promised -------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_deviations_are_those_that_were_predicted() -> None:
    """Over repeated noise: each variance, the volume of the ellipsoid, and no bias."""
    found, seen = excited(), rows(excited().trajectory)
    assert found.safe
    predicted, truth, r = (
        np.array(found.conditioning.std),
        known().truth,
        known().base.rank,
    )
    estimates = seen.estimates(SEEDS)
    squares = (SEEDS - 1) * estimates.var(axis=0, ddof=1) / predicted**2
    low, high = chi2.interval(1 - 1e-4, SEEDS - 1)
    assert ((low < squares) & (squares < high)).all(), squares / (SEEDS - 1)
    # log det of a sample covariance: a sum of logarithms of chi-squared numbers with ever fewer degrees of freedom
    half = (SEEDS - 1 - np.arange(r)) / 2
    expected = (
        np.sum(digamma(half) + np.log(2 / (SEEDS - 1))) - found.conditioning.log_det
    )
    assert abs(log_det(np.cov(estimates.T)) - expected) < 4 * np.sqrt(
        np.sum(polygamma(1, half))
    )
    assert (
        np.abs((estimates.mean(axis=0) - truth) / predicted * np.sqrt(SEEDS)).max()
        < 4.5
    )


@pytest.mark.slow
def test_a_log_gives_intervals_of_the_predicted_size(tmp_path: Path) -> None:
    """A fifth of the rows are left after filters, and no information is lost: the noise that is left is smaller.

    Classical intervals take neighbours of that noise for independent and come out a tenth too narrow; those of batches
    of time scatter, and are right in the middle.
    """
    motion = followed(excited().trajectory)
    predicted = np.array(excited().conditioning.std)
    batches = identified(tmp_path, motion).estimate
    ratio = batches.std / predicted
    assert 0.9 < np.median(ratio) < 1.2
    assert ratio.min() > 0.5
    assert ratio.max() < 2.0
    estimate = identified(tmp_path, motion, intervals="classical").estimate
    classical, friction = (
        estimate.std / predicted,
        np.array([name.startswith("F") for name in estimate.parameters]),
    )
    assert classical.min() > 0.8
    assert classical[~friction].max() < 1.15
    # also shown by rows beside starts and stops, which leave the fit; how many depends on the optimum that is found
    assert classical[friction].max() < 1.35
    # neither filters nor the way in which the robot follows cost more than a few per cent of what was promised
    errors = (batches.values - known().truth) / predicted
    assert np.mean(errors**2) == pytest.approx(1, abs=0.7)


@pytest.mark.slow
def test_the_robot_stays_near_the_trajectory() -> None:
    """Otherwise its log would not be one of the trajectory that was designed."""
    motion, trajectory = (
        followed(excited().trajectory, unmodelled=UNMODELLED),
        excited().trajectory,
    )
    assert np.abs(motion.q - trajectory(motion.time)).max() < 0.05
    assert (np.abs(motion.q) < 1.02 * POSITION).all()
    assert (np.abs(motion.qd) < 1.1 * VELOCITY).all()
    assert (np.abs(motion.y) < EFFORT).all()


# -- better than others ------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_better_than_random_motions_and_sines() -> None:
    """With the same limits, noise and duration."""
    held_out = [rows(random_motion(seed)) for seed in (100, 101)]

    def judged(trajectory: Trajectory) -> tuple[float, float, float]:
        seen = rows(trajectory)
        estimates = seen.estimates(20)
        error = np.sqrt(np.mean([fresh.errors(estimates) ** 2 for fresh in held_out]))
        return (
            log_det(seen.information),
            scaled_condition(seen.information),
            float(error),
        )

    best = [judged(excited(seed).trajectory) for seed in range(2)]
    rest = {name: judged(trajectory) for name, trajectory in others()}
    volume, condition, error = (np.array(values) for values in zip(*best, strict=True))
    volumes, conditions, errors = (
        np.array(values) for values in zip(*rest.values(), strict=True)
    )
    # log det of F is −2 Σ log of the deviations along its axes: smaller by a seventh than the best of the others
    assert volume.min() > volumes.max() + 0.3 * known().base.rank, rest
    assert condition.max() < np.median(conditions)
    assert error.max() < errors.min(), rest
    assert error.mean() < 0.75 * errors.mean()


@pytest.mark.slow
def test_better_with_unmodelled_effects(tmp_path: Path) -> None:
    """The whole way: forward dynamics, joints that cog and stick, noisy logs, filters; fresh motions are predicted."""
    fresh = followed(random_motion(99), unmodelled=UNMODELLED)
    scores: dict[str, list[float]] = {"excited": [], "random": [], "sines": []}
    for seed in range(4):
        motions = {
            "excited": excited(seed).trajectory,
            "random": random_motion(seed),
            "sines": sines(seed),
        }
        for kind, trajectory in motions.items():
            (folder := tmp_path / f"{kind}{seed}").mkdir()
            found = identified(
                folder, followed(trajectory, unmodelled=UNMODELLED), fresh, seed
            )
            errors = (
                np.array([score.rms for score in found.validations[1].scores]) / NOISE
            )
            scores[kind].append(float(np.sqrt(np.mean(errors**2))))
    # what no model says is left in every prediction, so the advantage is smaller than without
    assert max(scores["excited"]) < 1.05 * min(scores["random"] + scores["sines"]), (
        scores
    )
    assert np.mean(scores["excited"]) < 0.95 * np.mean(scores["random"]), scores
    assert np.mean(scores["excited"]) < 0.95 * np.mean(scores["sines"]), scores


# -- complementing what is known ---------------------------------------------------------------------------------------


def complement(first: Floats, seed: int, **changes: Any) -> Floats:
    """Information of a trajectory that is designed to complement other information."""
    found = ec.exciting_trajectory(
        known().setup, prior_information=first, seed=seed, **changes
    )
    seen = rows(found.trajectory).information
    # what is shown is both together
    assert found.conditioning.log_det == pytest.approx(log_det(first + seen), rel=1e-9)
    return seen


@pytest.mark.slow
def test_a_complement_is_better_than_a_repetition() -> None:
    for seed in range(2):
        first = rows(excited(seed).trajectory).information
        assert log_det(first + complement(first, seed + 10, starts=1)) > log_det(
            2 * first
        ) + 0.1 * len(first)


@pytest.mark.slow
def test_a_complement_is_better_than_another_design() -> None:
    """By little, since every good trajectory shows everything, and only with several starts: optima are local."""
    gains = []
    for seed in range(3):
        first, another = (
            rows(excited(k, starts=4).trajectory).information for k in (seed, seed + 10)
        )
        gains.append(
            log_det(first + complement(first, seed + 10, starts=4))
            - log_det(first + another)
        )
    assert np.mean(gains) > 0.5
    assert min(gains) > -1


@pytest.mark.slow
def test_a_complement_of_a_one_sided_log() -> None:
    """The wrist was moved long and the arm hardly: variances come out smaller if that is known."""
    design = known().design
    rest, x = (
        design.problem.at_rest,
        design.trajectory(random_motion(5).coefficients).coefficients.copy(),
    )
    x[:, :3] = rest[:, :3] + 0.05 * (x - rest)[:, :3]
    first = 20 * rows(design.trajectory(x)).information
    for seed in range(2):
        options: dict[str, Any] = {"seed": seed, "criterion": "a_optimal", "starts": 4}
        alone = rows(
            ec.exciting_trajectory(known().setup, **options).trajectory
        ).information
        both = complement(first, **options)
        ratio = np.diag(np.linalg.inv(first + alone)) / np.diag(
            np.linalg.inv(first + both)
        )
        assert ratio.mean() > 1.1


@pytest.mark.parametrize("designed", slow_unless([False], [False, True]))
def test_information_of_a_log_is_that_of_its_trajectory(
    designed: bool, tmp_path: Path
) -> None:
    """Filters and decimation take away rows and noise alike."""
    trajectory = excited().trajectory if designed else random_motion(100)
    log = ARM.log(
        followed(trajectory),
        tmp_path / "run",
        known().base.mechanism,
        0,
        ENCODER,
    )
    ratio = np.diag(ec.information_of_logs(known().setup, [log])) / np.diag(
        rows(trajectory).information
    )
    assert ratio == pytest.approx(1, abs=0.15)


# -- more data ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_repetitions_shrink_deviations_by_their_root() -> None:
    predicted = np.array(excited().conditioning.std)
    spread = rows(excited().trajectory, 4).estimates(SEEDS).std(axis=0, ddof=1)
    low, high = np.sqrt(np.array(chi2.interval(1 - 1e-4, SEEDS - 1)) / (SEEDS - 1))
    ratio = 2 * spread / predicted
    assert ((low < ratio) & (ratio < high)).all(), ratio


@pytest.mark.slow
def test_logs_of_repetitions(tmp_path: Path) -> None:
    """Four periods in one log: half the deviations; not exactly, because filters spoil the ends of short logs more."""
    once, often = (
        identified(
            tmp_path,
            followed(excited().trajectory, periods),
            seed=periods,
            intervals="classical",
        )
        for periods in (1, 4)
    )
    assert np.median(once.estimate.std / often.estimate.std) == pytest.approx(
        2, rel=0.1
    )
    errors = (often.estimate.values - known().truth) / (
        np.array(excited().conditioning.std) / 2
    )
    assert np.mean(errors**2) == pytest.approx(1, abs=0.7)


# -- the example -------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_page_shows_what_the_example_prints() -> None:
    """The words agree, and numbers differ no more than between two platforms.

    Where numbers are rounded otherwise, the search may end at another optimum, about as good, where other
    limits bind.
    """
    script = ROOT / "examples" / "excite" / "closed_loop.py"
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=True
    )
    page = (ROOT / "docs" / "excitation-loop.md").read_text(encoding="utf-8")
    quoted = re.search(r"^```text\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert quoted is not None
    number, varying = (
        re.compile(r"\d+\.\d+"),
        re.compile(r"\d+\.\d+|(?<=at their limits: ).*"),
    )
    assert varying.sub("", quoted[1]).split() == varying.sub("", done.stdout).split()
    shown, printed = (
        np.array([float(some) for some in number.findall(text)])
        for text in (quoted[1], done.stdout)
    )
    excited_, random_, sines_ = printed[:-1].reshape(3, -1)
    assert excited_[0] == pytest.approx(shown[0], rel=0.01)
    assert excited_[1:] == pytest.approx(shown[1 : len(excited_)], rel=0.3)
    assert printed[len(excited_) :] == pytest.approx(shown[len(excited_) :], rel=0.15)
    assert (excited_[2:5] < 0.6 * np.minimum(random_, sines_)[2:5]).all()
