"""Findings when a simulated robot's log is poor, or differs from its set-up."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from echelon.identification.identifying import identify
from echelon.identification.logs.finding import Finding
from echelon.identification.result import Identification
from echelon.shared.errors import InputError
from support.selection import slow_unless
from support.simulated_models import Floats
from support.simulated_motions import RATE, fourier
from support.simulated_robots import TRUE, Motion, System
from support.simulated_systems import SHORT_ARM, SYSTEMS, motion_of

ARM, LONG_ARM = SHORT_ARM, SYSTEMS["arm"]
GOOD = "The model predicts every output well on unseen data"


def found(motion: Motion, folder: Path, system: System = ARM) -> Identification:
    """Identification of the arm from a noisy log of a motion."""
    setup = system.load(folder)
    return identify(setup, [system.log(motion, folder / "run", setup.mechanism)])


def of_kind(result: Identification, kind: str) -> list[Finding]:
    return [finding for finding in result.findings if finding.kind == kind]


def test_a_good_log_gives_no_finding(tmp_path: Path) -> None:
    result = found(motion_of(ARM), tmp_path)
    assert {finding.kind for finding in result.findings} == {
        "smooth"
    }  # as simulated positions are
    assert result.reasons == ()
    assert result.verdict.startswith(GOOD)


def test_faults_of_a_log_that_only_validates_are_named(tmp_path: Path) -> None:
    setup, motion = ARM.load(tmp_path), motion_of(ARM)
    holed = motion.y.copy()
    holed[200:220, 1] = np.nan
    good = ARM.log(motion, tmp_path / "good", setup.mechanism)
    bad = ARM.log(replace(motion, y=holed), tmp_path / "bad", setup.mechanism)
    (fault,) = of_kind(identify(setup, [good], [bad]), "not finite")
    assert str(bad) in fault.where


@pytest.mark.parametrize("flicker", slow_unless([1e-4], [0.0, 1e-4]))
def test_a_validation_at_rest_says_that_it_cannot_judge(
    flicker: float, tmp_path: Path
) -> None:
    """No model has the forces that hold a robot at rest: dry friction, a brake or a hand."""
    setup, motion = ARM.load(tmp_path), motion_of(ARM)
    held = (
        np.round(np.random.default_rng(3).uniform(0.45, 0.5001, motion.q.shape))
        * flicker
        + motion.q[700]
    )
    pushed = motion.y[700] + 5 * np.sin(motion.time)[:, None]
    still = replace(motion, q=held, qd=0 * motion.qd, qdd=0 * motion.qdd, y=pushed)
    good = ARM.log(motion, tmp_path / "good", setup.mechanism)
    result = identify(
        setup, [good], [ARM.log(still, tmp_path / "still", setup.mechanism, seed=1)]
    )
    assert result.verdict.startswith("No verdict on unseen data")
    assert "its joint rests" in result.verdict
    assert not of_kind(result, "setup error")
    assert result.reasons


@pytest.mark.parametrize("scale", slow_unless([1e-6], [1e-6, 1e-9]))
def test_torques_of_a_robot_lighter_than_any_are_not_predicted_well(
    scale: float, tmp_path: Path
) -> None:
    """All inertias are scaled alike, so that the prediction is as good as with the right unit."""
    setup, motion = ARM.load(tmp_path), motion_of(ARM)
    noisy = motion.y + np.array(ARM.noise) * np.random.default_rng(2).standard_normal(
        motion.y.shape
    )
    log = ARM.log(
        replace(motion, y=scale * noisy), tmp_path / "weak", setup.mechanism, seed=None
    )
    result = identify(setup, [log])
    assert min(score.r2 for score in result.validations[-1].scores) > 0.98
    assert result.verdict.startswith("Do not use the model")
    assert any("kg at a length of" in reason for reason in result.reasons)


def test_a_sign_that_is_wrong_in_a_log_that_only_validates_is_named(
    tmp_path: Path,
) -> None:
    setup, motion = ARM.load(tmp_path), motion_of(ARM)
    good = ARM.log(motion, tmp_path / "good", setup.mechanism)
    bad = ARM.log(
        replace(motion, q=motion.q * [1, -1, 1]),
        tmp_path / "bad",
        setup.mechanism,
        seed=1,
    )
    result = identify(setup, [good], [bad])
    (fault,) = of_kind(result, "setup error")
    assert fault.where == str(bad)
    assert "the sign of the position of" in fault.text
    assert f"'{setup.mechanism.positions[1]}'" in fault.text


def test_one_output_in_amperes_is_named(tmp_path: Path) -> None:
    motion = motion_of(ARM)
    result = found(replace(motion, y=motion.y * [1, 1 / 9, 1]), tmp_path)
    (fault,) = of_kind(result, "gains")
    assert "Is it a current" in fault.text
    assert f"the output of '{result.base.mechanism.outputs[1].name}'" in fault.text
    factor = re.search(r"State  scale: ([0-9.]+)", fault.text)
    assert factor is not None
    assert float(factor[1]) == pytest.approx(9, rel=0.1)
    assert not of_kind(result, "setup error")


# -- poor excitation ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def still(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Identification, Floats, Floats]:
    """A log in which the third joint does not move; with the truth and the exact reduced regressor."""
    folder = tmp_path_factory.mktemp("still")
    q, qd, qdd = fourier(np.random.default_rng(11), 5, 0.9)
    q[:, 2], qd[:, 2], qdd[:, 2] = 0.3, 0, 0
    motion = Motion(
        np.arange(len(q)) / RATE,
        q,
        qd,
        qdd,
        LONG_ARM.inverse(LONG_ARM.mjcf(TRUE), q, qd, qdd),
    )
    result = found(motion, folder, LONG_ARM)
    (folder / "true").mkdir()
    base, standard = LONG_ARM.truth(folder / "true")
    return result, base.values(standard), base.regressor(q, qd, qdd)


def test_open_combinations_are_counted(
    still: tuple[Identification, Floats, Floats],
) -> None:
    result, _, X = still
    # of a joint that rests, dry friction takes whatever torque there is, so its rows say nothing
    rows = X[:, [0, 1, 3, 4]].reshape(-1, X.shape[2])
    scales = np.linalg.norm(rows, axis=0)
    singular = np.linalg.svd(rows / np.where(scales == 0, 1, scales), compute_uv=False)
    rank = int(np.sum(singular > 1e-9 * singular[0]))
    assert result.conditioning.rank == rank < result.base.rank
    assert (
        sum(direction.singular_value == 0 for direction in result.conditioning.weak)
        == result.base.rank - rank
    )
    said = [finding.text for finding in of_kind(result, "conditioning")]
    assert (
        sum(f"the data determine {rank} of 42 base parameters" in text for text in said)
        == 1
    )


def test_open_combinations_are_named_with_advice(
    still: tuple[Identification, Floats, Floats],
) -> None:
    result = still[0]
    advice = [direction.advice for direction in result.conditioning.weak]
    for friction in ("Fv3", "Fc3"):
        said = f"the data do not show {friction}: move j3 at more different speeds, in both directions"
        assert said in advice
    assert all("j3" in some for some in advice)
    assert {finding.text for finding in of_kind(result, "conditioning")} >= set(
        advice[:10]
    )
    (constant,) = of_kind(result, "constant")
    assert "'j3'" in constant.where


def test_what_is_determined_is_right(
    still: tuple[Identification, Floats, Floats],
) -> None:
    result, truth, _ = still
    determined = result.conditioning.independent_share > 0
    assert 5 < determined.sum() < len(truth)
    errors = (result.estimate.values - truth)[determined] / result.estimate.std[
        determined
    ]
    assert np.abs(errors).max() < 6
    assert np.mean(errors**2) < 3
    open_ = ~determined
    assert np.abs((result.estimate.values - truth)[open_]).max() > 0.05


# -- logs that are not what they should be -----------------------------------------------------------------------------


def _turned(motion: Motion) -> Motion:
    sign = np.ones(motion.y.shape[1])
    sign[1] = -1
    return replace(motion, y=motion.y * sign)


def _exchanged(motion: Motion) -> Motion:
    order = np.arange(motion.q.shape[1])
    order[1:3] = 2, 1
    return replace(motion, q=motion.q[:, order])


def _stranger(_: Motion) -> Motion:
    """Torques of a robot of another build: twice as long, with other axes."""
    axes = {
        "j1": (1.0, 0.0, 0.0),
        "j2": (0.0, 0.0, 1.0),
        "j3": (1.0, 0.0, 0.0),
        "j4": (0.0, 1.0, 0.0),
        "j5": (0.0, 0.0, 1.0),
    }
    parts = tuple(
        replace(
            part,
            axis=axes[part.joint],
            at=(2 * part.at[0], 2 * part.at[1], 2 * part.at[2]),
        )
        for part in LONG_ARM.parts
    )
    states = fourier(np.random.default_rng(5), 5, 0.9)
    other = replace(LONG_ARM, parts=parts)
    return Motion(
        np.arange(len(states[0])) / RATE, *states, other.inverse(other.mjcf(), *states)
    )


MISTAKES: dict[str, tuple[Callable[[Motion], Motion], str]] = {
    "sign of a torque": (
        _turned,
        "sign of the output of 'j2' (column 'tau_2')",
    ),
    "exchanged positions": (
        _exchanged,
        "position of 'j2' (column 'q_2') and the position of 'j3' (column 'q_3') are exchanged",
    ),
    "a slow clock": (
        lambda m: replace(m, time=1.5 * m.time),
        "the clock is wrong: the rate is about 1.5",
    ),
    "another robot": (_stranger, ""),
}


@pytest.mark.parametrize(
    ("name", "system"),
    slow_unless(
        lambda case: case[1] is ARM,
        [("sign of a torque", ARM), *((name, LONG_ARM) for name in MISTAKES)],
    ),
)
def test_mistakes_are_named(name: str, system: System, tmp_path: Path) -> None:
    """Least squares would have numbers for anything, but they are those of no robot, or predict badly."""
    plant, words = MISTAKES[name]
    result = found(plant(motion_of(system)), tmp_path, system)
    assert result.verdict.startswith(
        ("Do not use the model", "The model is poor", "The model cannot")
    )
    assert result.reasons
    named = [finding.text for finding in of_kind(result, "setup error")]
    assert len(named) == bool(words)
    assert all(words in text for text in named)


def test_torques_that_have_nothing_to_do_with_the_motion(tmp_path: Path) -> None:
    motion = motion_of(ARM)
    result = found(
        replace(motion, y=np.random.default_rng(0).normal(size=motion.y.shape)),
        tmp_path,
    )
    (finding,) = of_kind(result, "stranger")
    assert "check for a log of another robot, exchanged columns" in finding.text
    assert result.verdict.startswith(
        "No verdict: no output varied by more than its sensor's noise"
    )
    assert result.reasons


def test_computed_torques_are_recognised(tmp_path: Path) -> None:
    """They have no noise, and are explained without a filter."""
    setup, motion = ARM.load(tmp_path), motion_of(ARM)
    some = motion.at(slice(0, 1000))
    base, standard = ARM.truth(tmp_path)
    y = base.predict(some.q, some.qd, some.qdd, base.values(standard))
    log = ARM.log(replace(some, y=y), tmp_path / "run", setup.mechanism, seed=None)
    (finding,) = of_kind(identify(setup, [log]), "computed")
    assert "they look computed or commanded" in finding.text


def test_degrees_for_radians_are_refused(tmp_path: Path) -> None:
    motion = motion_of(ARM)
    with pytest.raises(InputError, match=r"are they in degrees \(unit: deg\)"):
        found(replace(motion, q=np.degrees(motion.q)), tmp_path)


def test_torques_that_are_all_zero_are_refused(tmp_path: Path) -> None:
    motion, silent = motion_of(ARM), replace(ARM, noise=(0.5, 0.8, 0.0))
    y = motion.y * [1, 1, 0]
    with pytest.raises(InputError, match="'j3': all its measured values are zero"):
        found(replace(motion, y=y), tmp_path, silent)


def test_a_robot_with_fewer_joints_is_refused(tmp_path: Path) -> None:
    motion = motion_of(ARM)
    fewer = replace(motion, q=motion.q[:, :2], y=motion.y[:, :2])
    folder = tmp_path / "arm"
    folder.mkdir()
    setup = ARM.load(folder)
    rows = np.column_stack([fewer.time, fewer.q, fewer.y])
    head = ",".join(
        ["time", *(f"q_{k}" for k in range(1, 3)), *(f"tau_{k}" for k in range(1, 3))]
    )
    log = folder / "run.csv"
    np.savetxt(log, rows, delimiter=",", header=head, comments="")
    with pytest.raises(InputError, match=r"there are no columns 'q_3' .*, 'tau_3' "):
        identify(setup, [log])


def test_too_few_samples_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="60 samples are too few"):
        found(motion_of(ARM).at(slice(0, 60)), tmp_path)
