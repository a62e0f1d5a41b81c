"""The report: what stands in it is true, nothing from a file becomes markup; it needs nothing but itself."""

from __future__ import annotations

import json
import re
import sys
from base64 import b64decode
from dataclasses import replace
from itertools import pairwise
from math import inf, nan
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import welch

import echelon as ec
from echelon.identification.result import Identification
from echelon.identification.scores import Trace, Validation
from echelon.report.drawing import drawable_pose, drawing, pose_at, seen_bodies
from echelon.report.matrix_picture import matrix_picture, mergings
from echelon.report.page import (
    plotly_source,
    script_safe,
    significant,
    stretches_for,
    with_uncertainty,
)
from echelon.report.report import TITLES, report_html
from echelon.report.signals import envelope, payload, residual
from echelon.shared.errors import MissingExtraError
from support.derived import base_of
from support.paths import EXAMPLES
from support.report_data import Page, bare, hostile, identification
from support.selection import examples, slow_unless
from support.textbook_poses import pose_of


@pytest.fixture(scope="module")
def full() -> Identification:
    return identification()


@pytest.fixture(scope="module")
def page(full: Identification) -> Page:
    return Page(report_html(full))


def test_same_input_same_page(full: Identification) -> None:
    assert report_html(full) == report_html(identification())


def test_everything_is_there(page: Page, full: Identification) -> None:
    anchors = {attributes.get("id") for _, attributes in page.elements}
    assert {*TITLES} | {"top", "page-data"} <= anchors
    assert page.open == []
    for said in (
        full.judgement.sentence,
        *full.judgement.beside,
        *full.judgement.remarks,
        *(f.text for f in full.findings),
        "run1.parquet",
        "run2.parquet",
        "verified in rational",
    ):
        assert said in page.words
    for expression in full.base.expressions:
        assert expression.name in {
            a.get("data-text", "").split(" ")[0] for t, a in page.elements if t == "tr"
        }


def test_warnings_come_first(page: Page) -> None:
    places = [
        page.words.index(text) for text in ("was cut in two", "87 N·m", "resampled to")
    ]
    assert places == sorted(places)
    assert page.words.index("2 warnings, 1 note") < places[0]


@pytest.mark.parametrize("make", [identification, bare])
def test_nothing_is_loaded(make) -> None:
    """References lead into the page itself, and its policy forbids all others."""
    html = report_html(make())
    page = Page(html)
    for tag, attributes in page.elements:
        assert tag not in ("link", "iframe", "img", "object", "embed", "base")
        for name, value in attributes.items():
            if name in ("href", "src", "xlink:href", "action", "data"):
                assert (value or "").startswith("#"), (tag, name, value)
            assert name != "content" or "http" not in (value or "")
    own = html.replace(str(plotly_source()), "")
    assert not re.search(r"https?://|url\(|@import|//[a-z]+\.", own.replace("// ", ""))
    policy = next(
        a["content"]
        for t, a in page.elements
        if a.get("http-equiv") == "Content-Security-Policy"
    )
    assert policy is not None
    assert policy.startswith("default-src 'none';")


def test_one_copy_of_plotly() -> None:
    html = report_html(bare())
    assert html.count(str(plotly_source())) == 1
    assert len(Page(html).scripts) == 3
    assert len(html) < 5.6e6


def test_hostile_names_never_become_markup(full: Identification) -> None:
    clean, dirty = Page(report_html(full)), Page(report_html(hostile(full)))
    allowed = {tag for tag, _ in clean.elements}
    assert {tag for tag, _ in dirty.elements} <= allowed
    known = {name for _, attributes in clean.elements for name in attributes}
    assert {name for _, attributes in dirty.elements for name in attributes} <= known
    assert dirty.open == []
    assert len(dirty.scripts) == 3
    assert dirty.scripts[1:] == clean.scripts[1:]
    assert dirty.words.count("<script>alert(1)</script>") > 20  # shown, as text
    assert "{{ 7 * 7 }}" in dirty.words
    json.loads(dirty.scripts[0])


@examples(10)
@given(st.text())
def test_json_cannot_end_a_script(text: str) -> None:
    packed = script_safe({text: text})
    assert json.loads(packed) == {text: text}
    assert not re.search(r"[<>&\u2028\u2029]", packed)


@pytest.mark.parametrize(
    "robot",
    slow_unless(
        lambda robot: robot not in ("panda", "tx40"),
        [
            "cart_pole",
            "furuta",
            "panda",
            "floating_tree",
            "coupled_arm",
            "tx40",
            "loops/parallelogram",
        ],
    ),
)
def test_any_robot(robot: str) -> None:
    """Sliding, floating, many joints, lengths without values, effects, loops."""
    run = identification("double_pendulum")
    base = base_of(robot)
    rng = np.random.default_rng(3)
    r = base.rank
    one = replace(
        run, base=base, essential=None, physical=None,
        feasibility=replace(run.feasibility, nearest=None),
        estimate=replace(run.estimate, parameters=base.pivots, units=base.units, values=rng.normal(size=r),
                         covariance=np.eye(r)),
        conditioning=replace(run.conditioning, independent_share=np.ones(r), singular_values=np.ones(r), weak=()),
    )  # fmt: skip
    page = Page(report_html(one))
    assert page.open == []
    assert ("No drawing" in page.words) == (robot == "coupled_arm")


def test_little_is_enough() -> None:
    """No prior, no unseen data, no physical fit, no findings; and no signals at all."""
    words = Page(report_html(bare())).words
    for said in (
        "No data were held out",
        "No physically consistent fit",
        "No warnings about",
        "was not tested",
    ):
        assert said in words
    assert "prior rms" not in words
    nothing = Page(report_html(replace(bare(), validations=())))
    assert "No signals were kept" in nothing.words
    assert nothing.open == []


def test_numbers_that_are_none() -> None:
    """nan and inf, wherever they can occur, are shown and leave the data readable."""
    run = identification(samples=300)
    first, second = run.validations
    rows = len(first.traces[0].time)
    one, two = first.traces
    traces = (
        replace(one, measured=np.full(rows, nan), raw=replace(one, raw=None)),
        replace(
            two,
            predicted=np.full(rows, inf),
            raw=replace(two, predicted=np.full(rows, nan)),
        ),
    )
    lost = replace(first.scores[0].whole, rms=inf, bias=nan, deviation=0.0, low=nan)
    scores = tuple(
        replace(s, whole=lost, raw=lost, whiteness=nan) for s in first.scores
    )
    r = run.base.rank
    dirty = replace(
        run,
        validations=(replace(first, traces=traces, scores=scores, prior_scores=scores), second),
        estimate=replace(run.estimate, values=np.array([nan, inf, 0.0, 1e300, -1e-300, 1.0]),
                         covariance=np.diag([inf, 0, nan, 1, 1, 4.0])),
        conditioning=replace(run.conditioning, condition=inf, scaled_condition=nan, independent_share=np.full(r, nan),
                           singular_values=np.array([1, 0, 0, nan, 0, 0.0]), rank=1),
    )  # fmt: skip
    page = Page(report_html(dirty))
    json.loads(page.scripts[0], parse_constant=lambda name: pytest.fail(name))
    assert "∞" in page.words
    assert not re.search(r"\b(nan|inf)\b", page.words)


def test_size_of_a_large_report() -> None:
    html = report_html(identification("panda", samples=100_000))
    assert 5e6 < len(html.encode()) < 8e6


def test_without_plotly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    with pytest.raises(MissingExtraError, match=r"echelon-robotics\[identify\]"):
        report_html(bare())


def test_settings_are_read_only_mappings(full: Identification) -> None:
    settings = MappingProxyType({"seed": np.int64(7), "cutoffs": np.array([1.5, 2.0])})
    assert '"seed": 7' in Page(report_html(replace(full, settings=settings))).words


def test_intervals_have_the_level_of_the_settings(full: Identification) -> None:
    narrow = replace(full, settings={**full.settings, "level": 0.5})
    assert "50 % interval" in Page(report_html(narrow)).words
    assert "95 % interval" in Page(report_html(full)).words


def test_every_plot_has_stretches_enough_for_a_curve_and_no_more_than_pixels() -> None:
    found = [stretches_for([100_000] * count) for count in (0, 1, 200, 10_000)]
    assert found[0] == found[1] == 1200 > found[2] > 100 == found[3]
    mixed = stretches_for([100_000] * 100 + [200] * 100)
    assert stretches_for([100_000] * 200) < mixed < stretches_for([100_000] * 100)


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
    t = (
        np.cumsum([random.choice([0.01, 0.01, 0.01, 1.0]) for _ in values])
        if values
        else np.zeros(0)
    )
    found = envelope(t, y, buckets)
    good = np.isfinite(y)
    assert (found.samples, found.lost) == (len(y), int((~good).sum()))
    drawn = np.isfinite(found.values)
    assert (np.diff(found.time) >= 0).all()
    assert drawn.sum() <= max(2 * buckets + 2, 0)
    pairs = set(zip(t[good].tolist(), y[good].tolist(), strict=True))
    assert (
        set(zip(found.time[drawn].tolist(), found.values[drawn].tolist(), strict=True))
        <= pairs
    )
    if not good.any():
        return
    edges = np.linspace(t[good][0], t[good][-1], buckets + 1)
    place = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, buckets - 1)
    kept_place = np.clip(
        np.searchsorted(edges, found.time, side="right") - 1, 0, buckets - 1
    )
    inside = (
        np.abs(t[:, None] - edges).min(axis=1) > 1e-9
    )  # rounding decides at the very edge
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
    assert trace.raw is not None

    def spiky(trace: Trace) -> Trace:
        measured = trace.measured.copy()
        measured[len(measured) // 2] = 1e4
        return replace(trace, measured=measured)

    for one, other in (("fitted", trace), ("raw", trace.raw)):
        both = spiky(replace(trace, raw=spiky(trace.raw)))
        data = payload([replace(full.validations[1], traces=(both,))])
        view = data["traces"]["0/0"][one]
        for name in ("measured", "residual"):
            values = np.frombuffer(b64decode(view["signals"][name][1]), dtype="<f4")
            assert values.max() > 9.9e3
        assert view["samples"] == len(other.time)


def test_rows_are_told_by_output_and_samples(page: Page) -> None:
    """500 rows of each output, of 2500 samples, under a filter to 20 Hz."""
    assert (
        "Each output has 500 rows in the fit, made of 2 500 measured samples: these are filtered to 20 Hz, and "
        "one row stays of about 5 samples." in page.words
    )


def test_extremes_are_mentioned_where_they_are_drawn(page: Page) -> None:
    words = "Of long signals the smallest and the largest value"
    assert words in page.words
    assert words not in Page(report_html(identification(samples=1000))).words


def test_remarks_stand_in_the_cell_of_their_output(full: Identification) -> None:
    first, second = full.validations[1].scores
    coloured = replace(
        full.validations[1], scores=(first, replace(second, whiteness=0.001))
    )
    html = report_html(replace(full, validations=(full.validations[0], coloured)))
    cells = re.findall(r'<th scope="row" class="name"><bdi>(j\d)</bdi>(.*?)</th>', html)
    told = [name for name, rest in cells if "residual is not white" in rest]
    assert told == ["j2"]


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
        assert found.correlation[0] == pytest.approx(
            1.5 / 1.8, abs=0.02
        )  # ρ₁ = a₁ / (1 − a₂)


@pytest.mark.parametrize("y", [np.zeros(100), np.full(100, nan), np.ones(5)])
def test_no_residual_to_analyse(y: np.ndarray) -> None:
    assert residual(np.arange(len(y)) / 10, y) is None


# -- pictures ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "robot", ["panda", "puma560", "cart_pole", "floating_tree", "scara"]
)
def test_frames_agree_with_textbook_formulas(robot: str) -> None:
    mechanism = ec.load(EXAMPLES / f"{robot}.yaml")
    rng = np.random.default_rng(7)
    q = dict(
        zip(
            mechanism.positions,
            rng.uniform(-1, 1, len(mechanism.positions)).tolist(),
            strict=True,
        )
    )
    for motion in mechanism.motions:
        if len(motion.positions) == 4:
            unit = rng.normal(size=4)
            q |= dict(
                zip(
                    motion.positions,
                    (unit / np.linalg.norm(unit)).tolist(),
                    strict=True,
                )
            )
    found = pose_at(mechanism, np.array([q[name] for name in mechanism.positions]))
    poses: list[np.ndarray] = []
    for index, body in enumerate(mechanism.bodies):
        above = np.eye(4) if body.parent < 0 else poses[body.parent]
        poses.append(above @ pose_of(mechanism, index, q))
        assert found.origins[index] == pytest.approx(poses[-1][:3, 3], abs=1e-12)
        assert found.rotations[index] == pytest.approx(poses[-1][:3, :3], abs=1e-12)


@pytest.mark.parametrize(
    "robot", ["panda", "double_pendulum", "floating_tree", "puma560"]
)
def test_drawings_stay_on_their_paper(robot: str) -> None:
    base = base_of(robot)
    pose = drawable_pose(base.mechanism)
    assert pose is not None
    found = drawing(base.mechanism, pose, seen_bodies(base))
    points = [
        p for link in found.links for s in (*link.segments, link.axis) for p in s
    ] + [found.base]
    assert all(0 <= x <= found.width and 0 <= y <= found.height for x, y in points)
    for side in (True, False):
        heights = sorted(
            link.label[1]
            for link in found.links
            if link.label and (link.label[0] == 0) is side
        )
        assert all(b - a > 12 for a, b in pairwise(heights))


def test_matrix_picture_is_b() -> None:
    base = base_of("panda")
    picture = matrix_picture(base)
    b = base.B_float()
    assert {
        (round(c.y / picture.cell), round(c.x / picture.cell)) for c in picture.cells
    } == set(zip(*(index.tolist() for index in np.nonzero(b)), strict=True))
    kinds = {
        (round(c.y / picture.cell), round(c.x / picture.cell)): c.kind
        for c in picture.cells
    }
    for (row, column), kind in kinds.items():
        assert (kind == "pivot") == (base.matrix.pivots[row] == column)
        assert (kind in ("pivot", "number")) == (
            not base.matrix.rows[row][column].symbols()
        )
    assert sum(band.size for band in picture.columns) == pytest.approx(picture.width)
    assert sum(band.size for band in picture.rows) == pytest.approx(picture.height)


def test_where_parameters_went() -> None:
    """The double pendulum: ZZ1 + l1² M2, MX1 + l1 M2, MY1, ZZ2, MX2, MY2."""
    first, second = mergings(base_of("double_pendulum"))
    assert (first.alone, first.absorbs, first.absorbed) == (("MY",), ("2",), ())
    assert (second.alone, second.absorbs, second.absorbed) == (
        ("ZZ", "MX", "MY"),
        (),
        ("1",),
    )
    assert "ZZ" not in first.unseen
    assert "M" in first.unseen


def test_what_is_seen_of_each_body() -> None:
    first, second = seen_bodies(base_of("double_pendulum"))
    assert first.counts == {"alone": 1, "combined": 2, "unseen": 7}
    assert second.counts == {"alone": 3, "combined": 1, "unseen": 6}
    assert [b.level for b in seen_bodies(base_of("panda"))] == [1, 3, 4, 4, 4, 4, 4]


def test_residuals_against_speed_show_friction_that_is_lacking() -> None:
    """Means in bins of speed are the friction that the prediction leaves out; outputs without speeds have none."""
    time = np.arange(4000) / 200
    speed = np.sin(time) + 0.3 * np.sin(2.7 * time)
    left = np.tanh(speed / 0.1) + 0.05 * np.random.default_rng(1).normal(
        size=time.shape
    )
    measured = np.cos(time) + left
    traces = (
        Trace("drive", "N", time, measured, measured - left, None, speed),
        Trace("cut", "N", time, measured, measured),
    )
    empty = Validation("run", "validation", (), (), (), traces)
    of_drive, of_cut = (
        payload([empty])["traces"][f"0/{k}"]["speeds"] for k in range(2)
    )
    assert of_cut is None
    assert of_drive["unit"] == "m/s"
    middle, mean, low, high = (
        np.frombuffer(b64decode(of_drive[name]), dtype="<f4")
        for name in ("speed", "mean", "low", "high")
    )
    assert np.all(np.diff(middle) > 0)
    clear = np.abs(middle) > 0.3
    np.testing.assert_allclose(mean[clear], np.sign(middle[clear]), atol=0.03)
    np.testing.assert_allclose((high - low)[clear] / 2, 0.05, atol=0.02)
