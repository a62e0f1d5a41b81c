"""The report: what stands in it is true, nothing from a file becomes markup, and it needs nothing but itself."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from math import inf, nan
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echelon.errors import MissingExtraError
from echelon.identification.result import Identification
from echelon.report.page import plotly_source, script_safe
from echelon.report.report import TITLES, report_html
from support.report_data import Page, bare, base_of, hostile, identification


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
    assert {*TITLES} | {"top", "plot-data"} <= anchors
    assert page.open == []
    for said in (
        full.verdict,
        *(f.text for f in full.findings),
        "run1.parquet",
        "run2.parquet",
        "verified in rational",
    ):
        assert said in page.words
    for expression in full.base.expressions:
        assert expression.name in {a.get("data-text", "").split(" ")[0] for t, a in page.elements if t == "tr"}


def test_warnings_come_first(page: Page) -> None:
    places = [page.words.index(text) for text in ("was cut in two", "87 N·m", "resampled to")]
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
    policy = next(a["content"] for t, a in page.elements if a.get("http-equiv") == "Content-Security-Policy")
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


@given(st.text())
def test_json_cannot_end_a_script(text: str) -> None:
    packed = script_safe({text: text})
    assert json.loads(packed) == {text: text}
    assert not re.search(r"[<>&\u2028\u2029]", packed)


@pytest.mark.parametrize(
    "robot", ["cart_pole", "furuta", "panda", "floating_tree", "coupled_arm", "tx40", "loops/parallelogram"]
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
    assert ("There is no drawing" in page.words) == (robot == "coupled_arm")


def test_little_is_enough() -> None:
    """No prior, no unseen data, no physical fit, no findings, no verdict; and no signals at all."""
    words = Page(report_html(bare())).words
    for said in ("No data were kept back", "No physically consistent fit", "Nothing to warn of", "was not tested"):
        assert said in words
    assert "prior rms" not in words
    nothing = Page(report_html(replace(bare(), validations=())))
    assert "No signals were kept" in nothing.words
    assert nothing.open == []


def test_numbers_that_are_none() -> None:
    """nan and inf, wherever they can occur, are shown and leave the data readable."""
    run = identification(samples=300)
    first, second = run.validations
    broken = np.full(300, nan)
    traces = (replace(first.traces[0], measured=broken), replace(first.traces[1], predicted=np.full(300, inf)))
    lost = replace(first.scores[0].whole, rms=inf, bias=nan, deviation=0.0, low=nan)
    scores = tuple(replace(s, whole=lost, raw=lost, whiteness=nan) for s in first.scores)
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
