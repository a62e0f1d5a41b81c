"""Scores, residuals, traces, verdicts and what is held out, against closed forms and direct computation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example as case
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter
from scipy.stats import chi2, kstest

import echelon as ec
from echelon.identification.autocorrelation import Correlations, CorrelationSums
from echelon.identification.logs.preparation.prepare import Preparation
from echelon.identification.logs.recording import Samples
from echelon.identification.result import fitted_ranges
from echelon.identification.rows.plan import split
from echelon.identification.rows.rows import ModelRows
from echelon.identification.scores import (
    EMPTY,
    Fit,
    Grade,
    Score,
    Trace,
    Validation,
    fit,
    grade,
)
from echelon.identification.traces import TraceKeeper, thinned
from echelon.identification.validation import validated
from echelon.identification.verdict import (
    overall_verdict,
    pooled,
    verdict,
)
from support.observation_rows import ArrayRows, fit_of, judged_rows
from support.selection import examples


def direct(e: np.ndarray, present: np.ndarray, lag: int) -> float:
    """Autocorrelation over the pairs that there are, by its definition."""
    centred = np.where(present, e - e[present].mean(), 0)
    pairs = np.sum(present[lag:] & present[: len(e) - lag])
    return float(
        np.sum(centred[lag:] * centred[: len(e) - lag])
        / pairs
        / np.mean(centred[present] ** 2)
    )


def correlations(
    times: np.ndarray, residuals: np.ndarray, lags: int = 4096
) -> Correlations:
    """Correlations of the residuals of one stretch of rows."""
    sums = CorrelationSums(lags)
    sums.add(times, residuals)
    return sums.result()


# -- ranges -----------------------------------------------------------------------------------------------------------


def test_ranges_of_outputs_that_rub_and_of_wrenches() -> None:
    whole, moving = fit_of(0.1, 0.9, rows=100), fit_of(0.1, 0.9, rows=97)
    scores = (
        Score("j1", "N", whole, moving, whole, fastest=2.0),
        Score("base.fx", "N", whole, whole, whole),
    )
    preparation = Preparation(band=5.0, still={"j1": 0.01})
    slide, wrench = fitted_ranges(
        preparation, Validation("log", "identification", scores)
    )
    assert (
        str(slide)
        == "j1 up to 2 m/s, without 3 of 100 rows near standstill (below 0.01 m/s), up to 5 Hz"
    )
    assert str(wrench) == "base.fx, up to 5 Hz"


# -- residuals --------------------------------------------------------------------------------------------------------


@examples(30)
@given(st.integers(0, 10_000), st.integers(1, 60), st.floats(0, 0.6), st.floats(0, 2e9))
@case(1, 7, 0.0, 0.0)
@case(2, 60, 0.0, 0.0)
def test_autocorrelations_across_holes_and_blocks(
    seed: int, block: int, lost: float, start: float
) -> None:
    rng = np.random.default_rng(seed)
    e = np.cumsum(rng.normal(size=150)) + 5
    present = rng.uniform(size=150) >= lost
    present[:2] = True
    t = start + 0.01 * np.arange(150)
    sums = CorrelationSums(lags=40)
    rows = np.flatnonzero(present)
    # the time between samples is learnt from the first block: it needs neighbours
    for some in [rows[:2], *np.split(rows[2:], range(block, len(rows) - 2, block))]:
        sums.add(t[some], e[some], "one")
    found = sums.result()
    assert found.step == pytest.approx(0.01, rel=1e-3)
    for lag in (1, 2, 17, 40):
        assert found.values[lag] == pytest.approx(direct(e, present, lag), abs=1e-8)


def test_no_pair_reaches_across_segments() -> None:
    e = np.random.default_rng(1).normal(size=60)
    t = 0.1 * np.arange(60)
    sums = CorrelationSums(lags=8)
    sums.add(t[:25], e[:25], 0)
    sums.add(t[25:], e[25:], 1)
    found = sums.result()
    centred = e - e.mean()
    inside = np.sum(centred[3:25] * centred[:22]) + np.sum(
        centred[28:] * centred[25:57]
    )
    assert found.pairs[3] == 22 + 32
    assert found.values[3] == pytest.approx(inside / 54 / np.mean(centred**2))


def test_a_long_hole_costs_no_memory() -> None:
    e = np.random.default_rng(2).normal(size=40)
    t = np.concatenate([np.arange(20), 1e9 + np.arange(20)])
    found = correlations(t, e, lags=10)
    assert found.pairs[4] == 16 + 16


@pytest.mark.parametrize("a", [0.0, 0.5, 0.95])
def test_correlation_time_of_an_autoregressive_process(a: float) -> None:
    """1 + 2 Σ aᵏ = (1 + a)/(1 − a)."""
    e = lfilter([1], [1, -a], np.random.default_rng(3).normal(size=200_000))
    found = correlations(0.002 * np.arange(len(e)), e)
    assert found.time == pytest.approx(0.002 * (1 + a) / (1 - a), rel=0.08)


def test_ljung_box_by_its_formula_and_its_level() -> None:
    rng = np.random.default_rng(4)
    e = rng.normal(size=120)
    c = e - e.mean()
    r = np.array([c[k:] @ c[: 120 - k] / (c @ c) for k in range(1, 21)])
    statistic = 120 * 122 * np.sum(r**2 / (120 - np.arange(1, 21)))
    assert correlations(np.arange(120.0), e).whiteness() == pytest.approx(
        chi2.sf(statistic, 20)
    )
    # p-values of white noise are uniform, with holes too
    t = np.flatnonzero(rng.uniform(size=900) > 0.3).astype(float)
    p = [
        correlations(t, rng.normal(size=len(t)), lags=30).whiteness()
        for _ in range(300)
    ]
    assert kstest(p, "uniform").pvalue > 1e-3
    assert correlations(t, np.sin(0.3 * t)).whiteness() < 1e-10


# -- scores -----------------------------------------------------------------------------------------------------------


def example(
    seed: int = 6, rows: int = 400, **options: object
) -> tuple[np.ndarray, np.ndarray, ArrayRows]:
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(rows, 2, 3))
    y = W @ [1.0, -2.0, 0.5] + [0.1, 0.5] * rng.normal(size=(rows, 2)) + [10.0, -1000.0]
    return W, y, ArrayRows.of(W, y, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("seconds", [None, 0.0137, 0.1])
def test_scores_are_those_of_all_rows_at_once(seconds: float | None) -> None:
    values, prior = np.array([1.1, -2.0, 0.4]), np.zeros(3)
    keep = np.random.default_rng(7).uniform(size=(400, 2)) > 0.2
    W, y, rows = example(seconds=seconds, keep=keep)
    found = judged_rows(rows, values, prior, role="validation")
    for output, (score, of_prior) in enumerate(
        zip(found.scores, found.prior_scores, strict=True)
    ):
        measured = y[keep[:, output], output]
        for some, parameters in ((score, values), (of_prior, prior)):
            e = measured - (W[keep[:, output], output] @ parameters)
            assert some.rows == len(e)
            assert some.rms == pytest.approx(np.sqrt(np.mean(e**2)))
            assert some.bias == pytest.approx(e.mean())
            assert some.percent == pytest.approx(100 * some.rms / np.ptp(measured))
            assert some.r2 == pytest.approx(
                1 - np.sum(e**2) / np.sum((measured - measured.mean()) ** 2), rel=1e-9
            )
        e = measured - W[keep[:, output], output] @ values
        assert score.whiteness == pytest.approx(
            correlations(np.flatnonzero(keep[:, output]), e).whiteness()
        )
    assert found.source == "arrays"
    np.testing.assert_array_equal(found.traces[0].measured, y[keep[:, 0], 0])
    np.testing.assert_allclose(found.traces[1].predicted, W[keep[:, 1], 1] @ values)
    assert not found.traces[1].prior.any()  # type: ignore[union-attr]


def test_r2_of_a_small_signal_on_a_large_offset() -> None:
    """Sums of squares would lose all digits here."""
    signal = np.random.default_rng(8).normal(size=300)
    W = np.stack([np.ones(300), signal], axis=1)[:, None]
    rows = ArrayRows.of(W, (1e9 + 1e-3 * signal)[:, None], seconds=0.05)
    score = judged_rows(rows, [1e9, 0.5e-3], role="validation").scores[0]
    assert score.r2 == pytest.approx(0.75, abs=1e-3)


def test_a_perfect_model_and_a_constant_output() -> None:
    W = np.random.default_rng(9).normal(size=(50, 2, 2))
    y = W @ [1.0, 2.0]
    y[:, 1] = 3.0
    found = judged_rows(ArrayRows.of(W, y), [1.0, 2.0], role="identification")
    assert found.scores[0].r2 == pytest.approx(1)
    assert np.isnan(found.scores[1].r2)
    assert "No verdict on joint2" in found.verdict


@pytest.mark.parametrize(
    ("values", "message"), [([1.0], "expected 6"), ([np.nan] * 6, "finite")]
)
def test_wrong_values_are_refused(values: list[float], message: str) -> None:
    rows = ModelRows.of(
        ec.base_parameters(ec.load("examples/double_pendulum.yaml")), []
    )
    with pytest.raises(ec.InputError, match=message):
        validated(rows, [], {"model": np.array(values)}, role="validation")


def test_a_wrong_role_is_refused() -> None:
    with pytest.raises(ec.InputError, match="role"):
        judged_rows(example()[2], [1, 2, 3], role="test")


def test_no_rows_are_refused() -> None:
    rows = ArrayRows.of(np.zeros((0, 1, 1)), np.zeros((0, 1)))
    with pytest.raises(ec.InputError, match="no rows"):
        judged_rows(rows, [0.0], role="validation")


def test_a_fit_carries_over_to_the_held_out_end_of_its_log() -> None:
    """From samples to verdict, with a model that is right."""
    base = ec.base_parameters(ec.load("examples/double_pendulum.yaml"))
    rng = np.random.default_rng(12)
    t = np.linspace(0, 20, 2001)[:, None]
    rate, phase = (
        np.array([[1.3, 2.9], [3.7, 1.7]])[:, None],
        np.array([[0.3, 1.0], [2.0, 0.1]])[:, None],
    )
    q = np.sin(rate * t + phase).sum(axis=0)
    qd, qdd = (
        (rate * np.cos(rate * t + phase)).sum(axis=0),
        -(rate**2 * np.sin(rate * t + phase)).sum(axis=0),
    )
    truth = np.array([0.4, 1.0, 0.1, 0.05, 0.3, -0.02])
    y = base.predict(q, qd, qdd, truth) + 0.05 * rng.normal(size=(2001, 2))
    first, rest = split(Samples("log", 0.0, 100.0, q, qd, qdd, y), 0.3)
    rows = ModelRows.of(base, [first])
    values = rows.observation().combined().solve()
    models = {"model": values, "prior": 1.2 * truth}
    seen = validated(rows, [first], models, role="identification")
    found = validated(rows, [rest], models, role="validation", identification=seen)
    assert [s.rows for s in found.scores] == [601, 601]
    for score in found.scores:
        assert score.rms == pytest.approx(0.05, rel=0.1)
        assert score.correlation_time == pytest.approx(0.01, rel=0.5)
        assert score.whiteness > 1e-3
    assert "carries over" in found.verdict
    assert "beats the prior model on every output" in found.verdict
    assert found.traces[0].time[0] == pytest.approx(14.0)


def test_scores_of_logs_pool_to_those_of_all_their_rows() -> None:
    rng = np.random.default_rng(13)
    y, guess = 5 + rng.normal(size=(2, 300))
    parts = [fit(y[a:b], guess[a:b]) for a, b in ((0, 50), (50, 50), (50, 300))]
    whole = fit(y, guess)
    for name in Fit.__dataclass_fields__:
        assert getattr(parts[0] + parts[1] + parts[2], name) == pytest.approx(
            getattr(whole, name)
        )
    assert (parts[0] + parts[2]).r2 == pytest.approx(
        1 - np.sum((y - guess) ** 2) / np.sum((y - y.mean()) ** 2)
    )
    logs = [
        Validation("a", "validation", (Score("j1", "N·m", some, some, some),))
        for some in (parts[0], parts[2])
    ]
    assert pooled(logs).scores[0].r2 == pytest.approx(whole.r2)
    assert pooled(logs[:1]) is logs[0]


def test_rows_near_rest_and_samples_without_a_filter_are_scored() -> None:
    """Scores of all rows, of those that move, and of all samples; the noise of a sensor is what is white in it."""
    base = ec.base_parameters(ec.load("examples/double_pendulum.yaml"))
    rng = np.random.default_rng(14)
    q, qd, qdd = np.sin(0.01 * np.arange(400)[:, None] + rng.normal(size=(3, 1, 2)))
    truth = np.array([0.4, 1.0, 0.1, 0.05, 0.3, -0.02])
    moving = rng.uniform(size=(400, 2)) > 0.4
    clean = base.predict(q, qd, qdd, truth)
    y = clean + np.where(moving, 0.1, 0.5) * rng.normal(size=clean.shape)
    some = Samples(
        "log",
        0.0,
        100.0,
        q,
        qd,
        qdd,
        y,
        reduction=Mean(),
        first=2,
        stop=398,
        moving=moving,
    )  # type: ignore[arg-type]
    found = validated(
        ModelRows.of(base, []), [some], {"model": truth}, role="validation"
    ).scores
    for k, score in enumerate(found):
        raw = (y - clean)[2:398, k]
        assert score.raw.rms == pytest.approx(np.sqrt(np.mean(raw**2)))
        assert score.whole.rms == pytest.approx(np.sqrt(np.mean(raw[::2] ** 2)))
        assert score.moving.rms == pytest.approx(
            np.sqrt(np.mean(raw[::2][moving[2:398:2, k]] ** 2))
        )
        assert score.noise == pytest.approx(score.raw.rms, rel=0.3)


# -- traces -----------------------------------------------------------------------------------------------------------


@examples(30)
@given(
    st.integers(0, 1000),
    st.integers(1, 3000),
    st.integers(1, 500),
    st.integers(60, 400),
)
def test_traces_keep_all_peaks_and_invent_nothing(
    seed: int, count: int, block: int, limit: int
) -> None:
    rng = np.random.default_rng(seed)
    rows = np.stack(
        [
            np.arange(float(count)),
            *rng.standard_cauchy((2, count)),
            rng.normal(size=count),
        ],
        axis=1,
    )
    keeper = TraceKeeper(limit)
    for start in range(0, count, block):
        keeper.add(rows[start : start + block])
    kept = keeper.rows(4)
    np.testing.assert_array_equal(kept, rows[kept[:, 0].astype(int)])
    assert (np.diff(kept[:, 0]) > 0).all()
    for column in (rows[:, 1], rows[:, 2], rows[:, 1] - rows[:, 2]):
        assert {column.argmin(), column.argmax()} <= set(kept[:, 0].astype(int))
    if count <= limit:
        assert len(kept) == count
    assert len(kept) <= limit or len(kept) <= 6 * (1 + count // block)


def test_thinning_halves() -> None:
    rows = np.random.default_rng(10).normal(size=(12_000, 3))
    assert 12_000 / 4 < len(thinned(rows)) <= 6000


def test_scores_do_not_depend_on_how_much_is_kept() -> None:
    _, _, rows = example(rows=2000, seconds=0.1)
    full, few = (
        judged_rows(rows, [1, 2, 3], role="validation", limit=limit)
        for limit in (10_000, 300)
    )
    assert full.scores == few.scores
    assert len(full.traces[0].time) == 2000
    assert len(few.traces[0].time) <= 300
    assert few.traces[0].measured.max() == full.traces[0].measured.max()


# -- verdicts ---------------------------------------------------------------------------------------------------------


def score(
    output: str = "j1",
    rms: float = 1.0,
    r2: float = 0.99,
    bias: float = 0.0,
    white: float = 0.5,
) -> Score:
    found = fit_of(rms, r2, bias)
    return Score(output, "N·m", found, found, found, 0.0, 0.01, white)


def judged(
    *scores: Score, prior: Sequence[Score] = (), role: str = "validation"
) -> Validation:
    empty = np.zeros(0)
    return Validation(
        "run2",
        role,
        scores,
        tuple(prior),
        (),
        tuple(Trace("j1", "", empty, empty, empty) for _ in scores),
    )


@pytest.mark.parametrize(
    ("r2", "expected"),
    [
        (0.99, Grade.GOOD),
        (0.95, Grade.USABLE),
        (0.3, Grade.POOR),
        (-0.1, Grade.USELESS),
        (np.nan, None),
    ],
)
def test_grades(r2: float, expected: Grade | None) -> None:
    assert grade(score(r2=r2)) is expected


def test_verdict_names_what_is_bad() -> None:
    text = verdict(judged(score("j1"), score("j2", r2=-0.5), score("j3", r2=0.95)))
    assert (
        "j1 (R² 0.99) well; j3 (R² 0.95) usably; j2 (R² -0.5) worse than a constant would"
        in text
    )
    assert "biased for j1 (0.7 N·m)" in verdict(judged(score(bias=0.7)))
    assert "biased" not in verdict(judged(score(bias=0.3)))


def test_verdict_compares_with_the_fit_and_the_prior() -> None:
    fitted = judged(score("j1"), score("j2"), role="identification")
    assert "larger than on the fitted data for j2 (2 times)" in verdict(
        judged(score("j1"), score("j2", rms=2.0)), fitted
    )
    assert "carries over" in verdict(judged(score("j1"), score("j2", rms=1.4)), fitted)
    assert "carries over" not in verdict(fitted, fitted)
    better = judged(
        score("j1"), score("j2"), prior=[score("j1", rms=3.0), score("j2", rms=0.5)]
    )
    assert "beats the prior model on j1, which is better on j2" in verdict(better)
    assert "like the prior" in verdict(judged(score(), prior=[score(rms=1.01)]))
    assert "on every output" in verdict(judged(score(), prior=[score(rms=2)]))


def test_the_headline_goes_by_the_worst_output() -> None:
    fitted = judged(score(r2=0.999), role="identification")
    poor = overall_verdict(judged(score(), score("j2", r2=0.5, rms=2.0)))
    assert poor.text.startswith(
        "The model is poor for some outputs on unseen data; the lowest R² is 0.5,"
    )
    assert poor.reasons == ("on unseen data, j2 has R² 0.5",)
    assert "Check it on other data" in overall_verdict(fitted).text
    well = overall_verdict(judged(score()))
    assert well.text.startswith("The model predicts every output well")
    assert well.reasons == ()
    assert (
        "prior model predicts better"
        in overall_verdict(judged(score(), prior=[score(rms=0.5)])).text
    )
    assert "no output varied" in overall_verdict(judged(score(r2=np.nan))).text


def test_facts_contradict_the_best_prediction() -> None:
    found = overall_verdict(judged(score(r2=0.9999)), ["its parameters are unphysical"])
    assert found.text.startswith("Do not use the model")
    assert "its parameters are unphysical" in found.text
    assert "well" not in found.text
    assert found.reasons == ("its parameters are unphysical",)


def test_an_output_below_the_noise_of_its_sensor_is_not_judged() -> None:
    """Whatever else its residual is compared with, below R² 0.90 nothing is called good."""
    fitted = judged(score("j1"), score("j2"), role="identification")
    quiet = judged(score("j1"), score("j2", r2=0.4, rms=1.1))
    assert "R² of j2 is low because the output varies little here" in verdict(
        quiet, fitted
    )
    wrong = judged(score("j1"), score("j2", r2=0.4), role="identification")
    text = verdict(quiet, wrong)
    assert "R² of j2 is low on the fitted data, too" in text
    assert "varies little" not in text
    assert "carries over" not in text
    assert overall_verdict(quiet).text.startswith("The model is poor")
    silent = replace(quiet.scores[1], noise=2.0)
    found = overall_verdict(judged(score("j1"), silent))
    assert found.text.startswith("The model predicts every output well")
    assert "No verdict on j2: it varies less than the sensor noise." in found.text
    assert overall_verdict(judged(silent)).text.startswith(
        "No verdict: no output varied by more than"
    )


def test_an_output_at_rest_is_judged_only_by_what_is_predicted_well() -> None:
    rest = replace(score("j2", r2=-3.0), moving=EMPTY)
    assert grade(rest) is None
    assert grade(replace(score("j2", r2=0.99), moving=EMPTY)) is Grade.GOOD
    found = overall_verdict(judged(score("j1"), rest))
    assert found.text.startswith("The model predicts every output well")
    assert "No verdict on j2: its joint rests" in found.text
    alone = overall_verdict(judged(rest))
    assert alone.text.startswith(
        "No verdict on unseen data (run2): j2: its joint rests"
    )
    assert alone.reasons
    assert "overfitted" not in verdict(
        judged(rest), judged(score("j2", rms=0.1), role="identification")
    )


def test_the_verdict_of_an_overfitted_model() -> None:
    """Twenty parameters from thirty rows of noise."""
    rng = np.random.default_rng(11)
    W, y = rng.normal(size=(60, 1, 20)), rng.normal(size=(60, 1))
    few, rest = ArrayRows.of(W[:30], y[:30]), ArrayRows.of(W[30:], y[30:])
    values = few.observation().combined().solve()
    seen = judged_rows(few, values, role="identification")
    assert (
        "overfitted"
        in judged_rows(rest, values, role="validation", identification=seen).verdict
    )


# -- what is held out -------------------------------------------------------------------------------------------------


class Mean:
    """A moving average that keeps every second sample."""

    factor, reach = 2, 5

    def kept(self, count: int) -> np.ndarray:
        return np.arange(0, count, 2)

    def apply(self, values: np.ndarray) -> np.ndarray:
        return values[::2]


def samples(source: str = "a", count: int = 100, **options: object) -> Samples:
    ramp = np.arange(float(count))[:, None]
    plain = Samples(
        source, 5.0, 10.0, ramp, ramp, ramp, ramp, {"j1": ramp[:, 0]}, moving=ramp > 20
    )
    return replace(plain, **options)  # type: ignore[arg-type]


def test_split_by_time_shares_no_measured_value() -> None:
    whole = samples(reduction=Mean(), first=3, stop=98)
    fit, held = split(whole, 0.3)
    cut = 3 + int(0.7 * 95)
    assert (len(fit), len(held)) == (cut, 100 - cut)
    assert (fit.first, fit.stop) == (3, cut)
    assert (held.first, held.stop) == (0, 98 - cut)
    assert held.start == pytest.approx(5.0 + cut / 10)
    for some, start in ((fit, 0), (held, cut)):
        rows = np.arange(start, start + len(some))
        np.testing.assert_array_equal(some.q[:, 0], rows)
        np.testing.assert_array_equal(some.y[:, 0], rows)  # type: ignore[index]
        np.testing.assert_array_equal(some.inputs["j1"], rows)
        np.testing.assert_array_equal(some.moving[:, 0], rows > 20)  # type: ignore[index]


@given(st.floats(0.05, 0.95))
def test_split_keeps_the_share(share: float) -> None:
    fit, held = split(samples(count=1000), share)
    assert len(held) == pytest.approx(1000 * share, abs=1)
    assert len(fit) + len(held) == 1000
    assert held.first == 0


def test_what_cannot_be_split_is_refused() -> None:
    with pytest.raises(ec.InputError, match="1 sample cannot be split"):
        split(samples(count=1), 0.3)
    with pytest.raises(ec.InputError, match="share"):
        split(samples(), 1.0)


@pytest.mark.parametrize(
    ("r2", "facts", "badge"),
    [
        (0.99, [], "good"),
        (0.93, [], "usable"),
        (0.6, [], "poor"),
        (-0.5, [], "do not use"),
        (0.99, ["the clock is wrong", "a mass is negative"], "do not use"),
    ],
)
def test_a_verdict_has_a_badge_a_sentence_and_reasons(
    r2: float, facts: list[str], badge: str
) -> None:
    found = overall_verdict(judged(score("j1", r2=r2)), facts)
    assert found.badge == badge
    assert found.is_good == (badge in ("good", "usable"))
    assert [fact for fact in facts if fact in found.sentence] == []
    assert [fact for fact in facts if fact not in found.text] == []
    assert found.beside == found.reasons
    assert all(remark.endswith(".") for remark in found.remarks)
    assert found.sentence.endswith("(run2).")


def test_data_that_leave_parameters_open_speak_against_a_good_prediction() -> None:
    found = overall_verdict(judged(score("j1")), gaps=["the data show 2 of 4"])
    assert found.badge == "do not use"
    assert found.sentence.startswith("The model predicts every output well")
    assert found.reasons == ("the data show 2 of 4",)
