"""Parts of the report: digits, thinned signals, pictures of residuals, of B and of the robot."""

from __future__ import annotations

from base64 import b64decode
from dataclasses import replace
from itertools import pairwise
from math import inf, nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import welch

import echelon as ec
from echelon.report.drawing import drawable_pose, drawing, pose_at, seen_bodies
from echelon.report.matrix_picture import matrix_picture, mergings
from echelon.report.page import significant, with_uncertainty
from echelon.report.signals import envelope, payload, residual
from support.paths import EXAMPLES
from support.report_data import base_of, identification
from support.textbook_poses import pose_of

# -- numbers -----------------------------------------------------------------------------------------------------------


@given(st.floats(-1e12, 1e12), st.floats(1e-12, 1e12))
def test_digits_follow_the_uncertainty(value: float, std: float) -> None:
    """The text is off by less than a twentieth of the deviation (half a unit of its second digit)."""
    shown, deviation = (_read(text) for text in with_uncertainty(value, std))
    assert abs(shown - value) <= 0.051 * std + 1e-15 * abs(value)
    assert abs(deviation - std) <= 0.051 * std


@given(st.floats(-1e307, 1e307))
def test_significant_digits(value: float) -> None:
    assert abs(_read(significant(value)) - value) <= 5.1e-4 * abs(value) + 1e-320


def _read(text: str) -> float:
    plain = text.translate(str.maketrans("−⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "-0123456789-"))
    return float(plain.replace("×10", "e"))


# -- thinning out ------------------------------------------------------------------------------------------------------


@given(
    st.lists(st.floats(-1e6, 1e6) | st.sampled_from([nan, inf]), max_size=400),
    st.integers(1, 40),
    st.randoms(use_true_random=False),
)
def test_every_extreme_survives(values: list[float], buckets: int, random) -> None:
    """In every stretch of time; samples are real ones, in order, and few."""
    y = np.array(values, dtype=float)
    t = np.cumsum([random.choice([0.01, 0.01, 0.01, 1.0]) for _ in values]) if values else np.zeros(0)
    found = envelope(t, y, buckets)
    good = np.isfinite(y)
    assert (found.samples, found.lost) == (len(y), int((~good).sum()))
    drawn = np.isfinite(found.values)
    assert (np.diff(found.time) >= 0).all()
    assert drawn.sum() <= max(2 * buckets + 2, 0)
    pairs = set(zip(t[good].tolist(), y[good].tolist(), strict=True))
    assert set(zip(found.time[drawn].tolist(), found.values[drawn].tolist(), strict=True)) <= pairs
    if not good.any():
        return
    edges = np.linspace(t[good][0], t[good][-1], buckets + 1)
    place = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, buckets - 1)
    kept_place = np.clip(np.searchsorted(edges, found.time, side="right") - 1, 0, buckets - 1)
    inside = np.abs(t[:, None] - edges).min(axis=1) > 1e-9  # rounding decides at the very edge
    for k in set(place[good].tolist()):
        if inside[good & (place == k)].all():
            kept = found.values[drawn & (kept_place == k)]
            assert kept.min() == y[good & (place == k)].min()
            assert kept.max() == y[good & (place == k)].max()


def test_lines_break_at_gaps() -> None:
    t = np.concatenate([np.arange(100), 500 + np.arange(100)]) / 10
    for buckets in (10, 1000):
        found = envelope(t, np.sin(t), buckets)
        broken = np.flatnonzero(np.isnan(found.values))
        assert len(broken) == 1
        assert found.time[broken[0] - 1] < 11 < 49 < found.time[broken[0] + 1]


def test_plots_hold_the_peaks() -> None:
    full = identification()
    trace = full.validations[1].traces[0]
    measured = trace.measured.copy()
    measured[1234] = 1e4
    spiky = replace(full.validations[1], traces=(replace(trace, measured=measured),))
    data = payload([spiky])
    for name in ("measured", "residual"):
        values = np.frombuffer(b64decode(data["traces"]["0/0"]["signals"][name][1]), dtype="<f4")
        assert values.max() > 9.9e3
    assert data["traces"]["0/0"]["samples"] == len(measured)


# -- residuals ---------------------------------------------------------------------------------------------------------


def test_white_noise_looks_white() -> None:
    rng = np.random.default_rng(5)
    found = residual(np.arange(50_000) / 100, rng.normal(1.0, 2.0, 50_000))
    assert found is not None
    assert found.std == pytest.approx(2.0, rel=0.02)
    assert np.mean(np.abs(found.correlation) <= found.band) > 0.9
    assert found.amplitude == pytest.approx(found.white, rel=0.3)
    assert np.abs(found.density - found.normal).max() < 0.5
    assert found.density.sum() == pytest.approx(100)


def test_spectrum_agrees_with_welch_and_ignores_gaps() -> None:
    """A coloured signal, whole and with a tenth of its samples missing, against scipy's averaged periodogram."""
    rng, rate = np.random.default_rng(6), 200.0
    noise = rng.normal(size=60_000)
    y = np.zeros_like(noise)
    for k in range(2, len(y)):
        y[k] = 1.5 * y[k - 1] - 0.8 * y[k - 2] + noise[k]
    t = np.arange(len(y)) / rate
    frequency, power = welch(y, rate, nperseg=1024)
    kept = np.sort(rng.permutation(len(y))[: int(0.9 * len(y))])
    for choice, tolerance in ((slice(None), 0.12), (kept, 0.2)):
        found = residual(t[choice], y[choice])
        assert found is not None
        expected = np.sqrt(np.interp(found.frequency, frequency, power))
        strong = expected > 0.3 * expected.max()
        assert found.amplitude[strong] == pytest.approx(expected[strong], rel=tolerance)
        assert found.correlation[0] == pytest.approx(1.5 / 1.8, abs=0.02)  # ρ₁ = a₁ / (1 − a₂)


@pytest.mark.parametrize("y", [np.zeros(100), np.full(100, nan), np.ones(5)])
def test_no_residual_to_analyse(y: np.ndarray) -> None:
    assert residual(np.arange(len(y)) / 10, y) is None


# -- pictures ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("robot", ["panda", "puma560", "cart_pole", "floating_tree", "scara"])
def test_frames_agree_with_textbook_formulas(robot: str) -> None:
    mechanism = ec.load(EXAMPLES / f"{robot}.yaml")
    rng = np.random.default_rng(7)
    q = dict(zip(mechanism.positions, rng.uniform(-1, 1, len(mechanism.positions)).tolist(), strict=True))
    for motion in mechanism.motions:
        if len(motion.positions) == 4:
            unit = rng.normal(size=4)
            q |= dict(zip(motion.positions, (unit / np.linalg.norm(unit)).tolist(), strict=True))
    found = pose_at(mechanism, np.array([q[name] for name in mechanism.positions]))
    poses: list[np.ndarray] = []
    for index, body in enumerate(mechanism.bodies):
        above = np.eye(4) if body.parent < 0 else poses[body.parent]
        poses.append(above @ pose_of(mechanism, index, q))
        assert found.origins[index] == pytest.approx(poses[-1][:3, 3], abs=1e-12)
        assert found.rotations[index] == pytest.approx(poses[-1][:3, :3], abs=1e-12)


@pytest.mark.parametrize("robot", ["panda", "double_pendulum", "floating_tree", "puma560"])
def test_drawings_stay_on_their_paper(robot: str) -> None:
    base = base_of(robot)
    pose = drawable_pose(base.mechanism)
    assert pose is not None
    found = drawing(base.mechanism, pose, seen_bodies(base))
    points = [p for link in found.links for s in (*link.segments, link.axis) for p in s] + [found.base]
    assert all(0 <= x <= found.width and 0 <= y <= found.height for x, y in points)
    for side in (True, False):
        heights = sorted(link.label[1] for link in found.links if link.label and (link.label[0] == 0) is side)
        assert all(b - a > 12 for a, b in pairwise(heights))


def test_matrix_picture_is_b() -> None:
    base = base_of("panda")
    picture = matrix_picture(base)
    b = base.B_float()
    assert {(round(c.y / picture.cell), round(c.x / picture.cell)) for c in picture.cells} == set(
        zip(*(index.tolist() for index in np.nonzero(b)), strict=True)
    )
    kinds = {(round(c.y / picture.cell), round(c.x / picture.cell)): c.kind for c in picture.cells}
    for (row, column), kind in kinds.items():
        assert (kind == "pivot") == (base.matrix.pivots[row] == column)
        assert (kind in ("pivot", "number")) == (not base.matrix.rows[row][column].symbols())
    assert sum(band.size for band in picture.columns) == pytest.approx(picture.width)
    assert sum(band.size for band in picture.rows) == pytest.approx(picture.height)


def test_where_parameters_went() -> None:
    """The double pendulum: ZZ1 + l1² M2, MX1 + l1 M2, MY1, ZZ2, MX2, MY2."""
    first, second = mergings(base_of("double_pendulum"))
    assert (first.alone, first.absorbs, first.absorbed) == (("MY",), ("2",), ())
    assert (second.alone, second.absorbs, second.absorbed) == (("ZZ", "MX", "MY"), (), ("1",))
    assert "ZZ" not in first.unseen
    assert "M" in first.unseen


def test_what_is_seen_of_each_body() -> None:
    first, second = seen_bodies(base_of("double_pendulum"))
    assert first.counts == {"alone": 1, "combined": 2, "unseen": 7}
    assert second.counts == {"alone": 3, "combined": 1, "unseen": 6}
    assert [b.level for b in seen_bodies(base_of("panda"))] == [1, 3, 4, 4, 4, 4, 4]
