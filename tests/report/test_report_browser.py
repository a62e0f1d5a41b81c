"""The report in a browser: it draws, sorts and searches, complains of nothing, and fits on narrow screens."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from echelon.report.report import report_html
from support.browser import Browser, check_buttons
from support.report_data import bare, hostile, identification

BROWSER = Browser()
DRIVER = """
<script>
setTimeout(() => {
  const table = document.getElementById("parameter-table"), search = document.getElementById("search");
  const first = () => table.tBodies[0].rows[0].dataset.text.split(" ")[0];
  const log = document.getElementById("log"), caption = document.querySelector(".caption");
  const state = { first: [first()], wide: document.documentElement.scrollWidth - innerWidth };
  const value = [...table.tHead.querySelectorAll("button")].find((b) => b.ariaLabel === "sort by value");
  for (let k = 0; k < 2; k++) { value.click(); state.first.push(first()); }
  state.sorted = value.parentElement.getAttribute("aria-sort");
  search.value = "zz2"; search.dispatchEvent(new Event("input"));
  state.found = [...table.tBodies[0].rows].filter((row) => !row.hidden).length;
  const lines = () => [...document.querySelector("[data-plot=trace]").data].map((d) => [d.name, d.y[10]]);
  state.lines = [lines()];
  log.value = "0"; log.dispatchEvent(new Event("change"));
  state.lines.push(lines());
  document.getElementById("prior").click();
  state.lines.push(lines());
  state.caption = caption.textContent;
  const view = document.getElementById("view");
  view.value = "fitted"; view.dispatchEvent(new Event("change"));
  state.fitted = lines(); state.rows = caption.textContent;
  state.buttons = [...document.querySelectorAll(".modebar-btn")].map((b) => b.getAttribute("data-title"));
  const mark = document.querySelector(".matrix use");
  mark.dispatchEvent(new PointerEvent("pointerenter"));
  state.entry = document.getElementById("entry").textContent;
  const result = document.createElement("output"); result.id = "result"; result.textContent = JSON.stringify(state);
  document.body.append(result);
}, 3000);
</script>
"""


@cache
def html_of(kind: str) -> str:
    run = {
        "full": identification,
        "bare": bare,
        "hostile": lambda: hostile(identification()),
    }[kind]()
    return report_html(run)


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> dict:
    return BROWSER.drive(
        tmp_path_factory.mktemp("driven"), html_of("full"), DRIVER, "1280,6000"
    )


def test_the_console_is_heard(tmp_path: Path) -> None:
    """Otherwise the other tests would prove nothing."""
    page = (
        "<html><head></head><body><script>alert(1); missing();</script></body></html>"
    )
    said = BROWSER.browse(tmp_path, page, "--dump-dom")[1]
    assert any("an alert" in line for line in said)
    assert any("missing is not defined" in line for line in said)


@pytest.mark.parametrize(
    "kind",
    [
        "hostile",
        pytest.param("full", marks=pytest.mark.slow),
        pytest.param("bare", marks=pytest.mark.slow),
    ],
)
def test_draws_without_complaint(kind: str, tmp_path: Path) -> None:
    """Plots are there, the console is silent, and nothing from a file became an element."""
    assert BROWSER.drawn(tmp_path, html_of(kind), "1280,6000") == 8


def test_sorts_and_searches(driven: dict) -> None:
    run = identification()
    names = np.array(run.base.pivots)[np.argsort(run.estimate.values)]
    assert driven["first"] == [run.base.pivots[0], names[0], names[-1]]
    assert driven["sorted"] == "descending"
    assert driven["found"] == sum("ZZ2" in str(e) for e in run.base.expressions)


def test_logs_and_the_prior_can_be_chosen(driven: dict) -> None:
    run = identification()
    before, after, prior = driven["lines"]
    assert [name for name, _ in before] == ["measured", "predicted", "residual"]
    assert [name for name, _ in prior] == ["measured", "prior", "predicted", "residual"]
    assert "2\u202f500 samples" in driven["caption"]
    for lines, validation in (
        (before, run.validations[1]),
        (after, run.validations[0]),
    ):
        trace = validation.traces[0].raw
        assert trace is not None
        assert (
            np.abs(trace.measured - lines[0][1]).min()
            < 1e-5 * np.abs(trace.measured).max()
        )
    assert before[0][1] != after[0][1]
    fitted = run.validations[0].traces[0].measured
    assert driven["fitted"][0][1] == pytest.approx(fitted[10], rel=1e-6)
    assert "500 rows, all drawn" in driven["rows"]


def test_no_button_talks_to_a_server(driven: dict) -> None:
    check_buttons(driven["buttons"])


def test_pointing_shows_closed_forms(driven: dict) -> None:
    assert driven["entry"] == "ZZ1 × 1 in ZZ1 + l1²·M2"


def test_no_wider_than_its_window(driven: dict) -> None:
    assert driven["wide"] == 0


def test_fits_narrow_screens(tmp_path: Path) -> None:
    measure = "<script>setTimeout(() => { document.title = document.documentElement.scrollWidth - innerWidth; }, 2000);"
    html = html_of("full").replace("</body>", f"{measure}</script></body>")
    dom, _ = BROWSER.browse(tmp_path, html, "--window-size=500,2000", "--dump-dom")
    assert "<title>0</title>" in dom


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 500])
def test_no_part_is_blank(width: int, tmp_path: Path) -> None:
    picture = BROWSER.picture(tmp_path, html_of("full"), f"{width},6000")
    assert picture.shape == (6000, width)
    for start in range(0, 5000, 500):
        assert picture[start : start + 500].std() > 3


@pytest.mark.slow
def test_prints(tmp_path: Path) -> None:
    """On paper plots are there too: a print draws those that were never on screen."""
    paper = BROWSER.printed(tmp_path, html_of("full"))
    assert paper.startswith(b"%PDF")
    assert len(paper) > 100_000
