"""The report in a browser: it draws, sorts and searches, complains of nothing, and fits on narrow screens."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from echelon.report.page import report_html
from report_data import Page, bare, hostile, identification

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--hide-scrollbars", "--enable-logging=stderr", "--v=0",
    "--virtual-time-budget=15000",
)  # fmt: skip

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")

GUARD = "<script>window.alert = () => console.error('an alert');</script>"
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
  state.buttons = [...document.querySelectorAll(".modebar-btn")].map((b) => b.getAttribute("data-title"));
  const mark = document.querySelector(".matrix use");
  mark.dispatchEvent(new PointerEvent("pointerenter"));
  state.entry = document.getElementById("entry").textContent;
  const result = document.createElement("output"); result.id = "result"; result.textContent = JSON.stringify(state);
  document.body.append(result);
}, 3000);
</script>
"""


def browse(folder: Path, html: str, *flags: str, guard: bool = True) -> tuple[str, list[str]]:
    """The document after its scripts have run, and what the console says."""
    assert CHROMIUM is not None
    (folder / "page.html").write_text(html.replace("<head>", f"<head>{GUARD}", 1) if guard else html, encoding="utf-8")
    command = [CHROMIUM, *FLAGS, f"--user-data-dir={folder / 'profile'}", *flags, (folder / "page.html").as_uri()]
    done = subprocess.run(command, capture_output=True, timeout=120, check=True)
    said = [line for line in done.stderr.decode(errors="replace").splitlines() if "CONSOLE" in line]
    return done.stdout.decode(), said


@cache
def html_of(kind: str) -> str:
    run = {"full": identification, "bare": bare, "hostile": lambda: hostile(identification())}[kind]()
    return report_html(run)


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> dict:
    html = html_of("full").replace("</body>", DRIVER + "</body>")
    dom, said = browse(tmp_path_factory.mktemp("driven"), html, "--window-size=1280,6000", "--dump-dom")
    assert said == []
    found = re.search(r'<output id="result">(.*?)</output>', dom, re.DOTALL)
    assert found
    return json.loads(found[1].replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&"))


def test_the_console_is_heard(tmp_path: Path) -> None:
    """Otherwise the other tests would prove nothing."""
    page = "<html><head></head><body><script>alert(1); missing();</script></body></html>"
    said = browse(tmp_path, page, "--dump-dom")[1]
    assert any("an alert" in line for line in said)
    assert any("missing is not defined" in line for line in said)


@pytest.mark.parametrize(
    "kind", ["hostile", pytest.param("full", marks=pytest.mark.slow), pytest.param("bare", marks=pytest.mark.slow)]
)
def test_draws_without_complaint(kind: str, tmp_path: Path) -> None:
    """Plots are there, the console is silent, and nothing from a file became an element."""
    dom, said = browse(tmp_path, html_of(kind), "--window-size=1280,6000", "--dump-dom")
    assert said == []
    page = Page(dom)
    classes = [attributes.get("class") or "" for _, attributes in page.elements]
    assert sum("js-plotly-plot" in names for names in classes) == 8
    assert not [tag for tag, _ in page.elements if tag in ("img", "iframe")]
    assert not [name for _, attributes in page.elements for name in attributes if name.startswith("on")]
    assert len(page.scripts) == 4  # with the guard
    for _, attributes in page.elements:
        assert not re.match("https?:", attributes.get("href") or attributes.get("src") or "")


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
    for lines, validation in ((before, run.validations[1]), (after, run.validations[0])):
        trace = validation.traces[0]
        assert np.abs(trace.measured - lines[0][1]).min() < 1e-5 * np.abs(trace.measured).max()
    assert before[0][1] != after[0][1]


def test_no_button_talks_to_a_server(driven: dict) -> None:
    assert driven["buttons"]
    assert not [title for title in driven["buttons"] if re.search("share|cloud|edit", title or "", re.IGNORECASE)]


def test_pointing_shows_closed_forms(driven: dict) -> None:
    assert driven["entry"] == "ZZ1 × 1 in ZZ1 + l1²·M2"


def test_no_wider_than_its_window(driven: dict) -> None:
    assert driven["wide"] == 0


def test_fits_narrow_screens(tmp_path: Path) -> None:
    measure = "<script>setTimeout(() => { document.title = document.documentElement.scrollWidth - innerWidth; }, 2000);"
    html = html_of("full").replace("</body>", f"{measure}</script></body>")
    dom, _ = browse(tmp_path, html, "--window-size=500,2000", "--dump-dom")
    assert "<title>0</title>" in dom


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 500])
def test_no_part_is_blank(width: int, tmp_path: Path) -> None:
    from PIL import Image

    shot = tmp_path / "shot.png"
    browse(tmp_path, html_of("full"), f"--window-size={width},6000", f"--screenshot={shot}")
    pixels = np.asarray(Image.open(shot).convert("L"), dtype=float)
    assert pixels.shape == (6000, width)
    for start in range(0, 5000, 500):
        assert pixels[start : start + 500].std() > 3


@pytest.mark.slow
def test_prints(tmp_path: Path) -> None:
    """On paper plots are there too: a print draws those that were never on screen."""
    paper = tmp_path / "page.pdf"
    _, said = browse(tmp_path, html_of("full"), f"--print-to-pdf={paper}", "--window-size=1280,800")
    assert said == []
    assert paper.read_bytes().startswith(b"%PDF")
    assert paper.stat().st_size > 100_000
