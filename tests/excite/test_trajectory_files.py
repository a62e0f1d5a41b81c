"""Files of trajectories of every kind: samples, repeats, rates, suffixes, and files that were cut off."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from echelon.errors import InputError, MissingExtraError
from echelon.excite.files import samples as samples_module
from echelon.excite.files.samples import sampled
from echelon.excite.files.trajectory_file import read_trajectory, write_trajectory
from echelon.excite.problem.trajectory import Trajectory, uniform_splines
from support.trajectory_motions import NAMES, UNITS, motion, smooth, states

SAMPLED = [".csv", ".parquet", ".yaml"]


# -- samples -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", SAMPLED)
def test_samples_read_back_as_the_spline_through_them(tmp_path: Path, suffix: str) -> None:
    """Also where the end is not a multiple of the step, and in another order."""
    there, path = smooth(2.0037), tmp_path / f"run{suffix}"
    write_trajectory(there, path, 250)
    found = read_trajectory(path, NAMES[::-1], UNITS[::-1])
    assert found.duration == pytest.approx(2.0037, abs=1e-9)
    t = np.linspace(0, found.duration, 501)
    mine, theirs = states(found, t), states(there, t)
    # times of messages are whole nanoseconds, which accelerations see divided by the step squared
    for order, tolerance in enumerate((1e-7, 1e-5, 2e-3)):
        np.testing.assert_allclose(
            mine[order][:, ::-1], theirs[order], rtol=0, atol=tolerance * np.abs(theirs[0]).max()
        )


def test_samples_end_with_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equal steps, but for a last one that is shorter; evaluated piece by piece or at once."""
    for duration, rate, last in ((2.0037, 250, 0.0037 % 0.004), (0.7, 30, 1 / 30), (2 * np.pi, 10, 2 * np.pi % 0.1)):
        there = smooth(duration)
        found = sampled(there, rate)
        np.testing.assert_allclose(np.diff(found.t)[:-1], 1 / rate, rtol=1e-9)
        assert found.t[-1] == duration
        assert found.t[-1] - found.t[-2] == pytest.approx(last, abs=1e-9)
        monkeypatch.setattr(samples_module, "_AT_ONCE", 7 * there.basis.size)
        for whole, pieces in zip(found.states, sampled(there, rate).states, strict=True):
            np.testing.assert_allclose(pieces, whole, rtol=0, atol=1e-12 * np.abs(whole).max())
        np.testing.assert_array_equal(found.states[1], there(found.t, 1))
        monkeypatch.undo()


def test_rounded_times_of_messages_contradict_nothing(tmp_path: Path) -> None:
    """Fast samples of a slow motion: whole nanoseconds alone change its accelerations by 40 %."""
    basis = uniform_splines(0.5, 1)
    t = np.linspace(0, 0.5, 30)
    points = np.linalg.lstsq(basis.values(t), np.column_stack([t + 0.01 * t**2, t]), rcond=None)[0]
    there, path = Trajectory(NAMES, UNITS, basis, points), tmp_path / "run.yaml"
    write_trajectory(there, path, 3001)
    found = read_trajectory(path, NAMES, UNITS)
    np.testing.assert_allclose(found(t, 1), there(t, 1), atol=1e-4)


@pytest.mark.parametrize("suffix", SAMPLED)
def test_a_polynomial_of_degree_five_is_exact(tmp_path: Path, suffix: str) -> None:
    there = motion(uniform_splines(1.0, 1))
    write_trajectory(there, tmp_path / f"run{suffix}", 10)
    found = read_trajectory(tmp_path / f"run{suffix}", NAMES, UNITS)
    t = np.linspace(0, 1, 50)
    np.testing.assert_allclose(found(t, 2), there(t, 2), rtol=0, atol=1e-9)
    # the property on which limits are checked: bounds hold everywhere
    for order in range(4):
        assert np.all(np.abs(found(t, order)).max(axis=0) <= found.basis.bounds(found.coefficients, order) + 1e-9)


@pytest.mark.parametrize("suffix", SAMPLED)
def test_a_periodic_motion_can_be_repeated(tmp_path: Path, suffix: str) -> None:
    there, path = smooth(1.0), tmp_path / f"run{suffix}"
    write_trajectory(there, path, 200, repeats=3)
    found = read_trajectory(path, NAMES, UNITS)
    assert found.duration == pytest.approx(3)
    t = np.linspace(0, 1, 40)
    np.testing.assert_allclose(found(t + 2), there(t), rtol=0, atol=1e-6)


@pytest.mark.parametrize("suffix", [".json", *SAMPLED])
def test_one_that_is_not_periodic_cannot(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    with pytest.raises(InputError, match="repeats: a motion that is not periodic cannot be run 2 times"):
        write_trajectory(motion(uniform_splines(2.0, 3)), path, 100, repeats=2)
    with pytest.raises(InputError, match="repeats: 0 is not a number of runs"):
        write_trajectory(smooth(), path, 100, repeats=0)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("rate", "problem"),
    [
        (0, "rate: 0 Hz is not a sampling rate"),
        (-5.0, "not a sampling rate"),
        (float("nan"), "not a sampling rate"),
        (2, "rate: 2 Hz gives 5 samples in 2 s; at least 6"),
        (1e9, r"rate: 1e\+09 Hz gives 2e\+09 samples; at most"),
    ],
)
def test_rates_that_are_wrong(rate: float, problem: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=problem):
        write_trajectory(smooth(), tmp_path / "run.csv", rate)


# -- files -------------------------------------------------------------------------------------------------------------


def test_suffixes_that_are_not_known(tmp_path: Path) -> None:
    for call in (lambda p: write_trajectory(smooth(), p, 100), lambda p: read_trajectory(p, NAMES, UNITS)):
        with pytest.raises(InputError, match=r"'.xml' names no kind.*valid are .json, .csv, .parquet, .yaml"):
            call(tmp_path / "run.xml")
    with pytest.raises(InputError, match="no such file"):
        read_trajectory(tmp_path / "run.csv", NAMES, UNITS)
    with pytest.raises(InputError, match="cannot be written"):
        write_trajectory(smooth(), tmp_path / "missing" / "run.csv", 100)


@pytest.mark.parametrize("suffix", [".json", *SAMPLED])
def test_equal_trajectories_give_equal_files_whole(tmp_path: Path, suffix: str) -> None:
    for name in ("one", "two"):
        write_trajectory(smooth(), tmp_path / f"{name}{suffix}", 100)
    assert (tmp_path / f"one{suffix}").read_bytes() == (tmp_path / f"two{suffix}").read_bytes()
    assert len(list(tmp_path.iterdir())) == 2  # nothing temporary is left


@pytest.mark.parametrize("share", [0.001, 0.1, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("suffix", [".json", ".parquet", ".yaml"])
def test_a_file_that_was_cut_off_is_one_clear_error(tmp_path: Path, suffix: str, share: float) -> None:
    path = tmp_path / f"run{suffix}"
    write_trajectory(smooth(), path, 100)
    content = path.read_bytes()
    path.write_bytes(content[: max(1, int((len(content) - 1) * share))])  # a last line break is no loss
    with pytest.raises(InputError) as caught:
        read_trajectory(path, NAMES, UNITS)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_a_table_cut_off_inside_a_line_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    write_trajectory(smooth(), path, 100)
    content = path.read_text()
    path.write_text(content[: content.rindex(",") - 30])
    with pytest.raises(InputError, match=r"cells|line"):
        read_trajectory(path, NAMES, UNITS)


def test_packages_that_are_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match=r"echelon-robotics\[excite\]"):
        write_trajectory(smooth(), tmp_path / "run.parquet", 100)
