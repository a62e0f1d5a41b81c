"""The preview in a browser: the robot moves, turns and stops, plots are there, and nothing is complained of."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from echelon.report.preview import preview_html
from support.browser import Browser, check_buttons
from support.preview_pages import broken, hostile, trajectory

# virtual time runs timers, but hardly draws frames: these come from timers too
BROWSER = Browser(
    "window.requestAnimationFrame = (step) => setTimeout(() => step(performance.now()), 16);"
)
DRIVER = """
<script>
const wait = (ms) => new Promise((done) => setTimeout(done, ms));
const byId = (id) => document.getElementById(id), canvas = byId("robot-view");
const seen = async () => { await wait(200); return canvas.toDataURL(); };
const value = () => Number(byId("time").value);
const now = () => [...document.querySelectorAll(".now .q")].map((node) => node.textContent);
const key = (node, name) => node.dispatchEvent(new KeyboardEvent("keydown", { key: name, bubbles: true }));
const pointer = (kind, clientX, clientY) =>
  canvas.dispatchEvent(new PointerEvent(kind, { pointerId: 1, clientX, clientY }));
async function drive() {
  await wait(1500);
  canvas.setPointerCapture = () => {};
  const state = { wide: document.documentElement.scrollWidth - innerWidth, times: [value()], now: [now()] };
  const start = await seen();
  state.stays = start === await seen();
  byId("play").click();
  state.label = byId("play").getAttribute("aria-label");
  await wait(1000); state.times.push(value());
  state.moves = start !== await seen();
  key(canvas, " ");
  state.times.push(value());
  const stopped = await seen();
  state.times.push(value());
  state.stops = stopped === await seen();
  byId("time").value = 3; byId("time").dispatchEvent(new Event("input"));
  state.times.push(value()); state.now.push(now()); state.clock = byId("clock").textContent;
  const other = await seen();
  state.slides = other !== stopped;
  const views = [other];
  pointer("pointerdown", 200, 200); pointer("pointermove", 260, 220); pointer("pointerup", 260, 220);
  views.push(await seen());
  pointer("pointermove", 400, 400);
  state.released = views[1] === await seen();
  canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: -200, bubbles: true, cancelable: true }));
  views.push(await seen());
  key(canvas, "ArrowLeft"); views.push(await seen());
  byId("show-names").click(); views.push(await seen());
  byId("show-names").click(); byId("show-path").click(); views.push(await seen());
  byId("show-path").click(); key(canvas, "0");
  state.reset = other === await seen();
  state.views = new Set(views).size;
  const plot = document.querySelector("[data-plot=motion]"), head = document.querySelector(".playhead");
  state.head = parseFloat(head.style.left);
  state.inside = [plot._fullLayout._size.l, plot._fullLayout._size.w];
  const shapes = () => plot.layout.shapes.map((shape) => shape.y0);
  const lines = () => plot.data.map((line) => [line.name, line.y[100]]);
  state.lines = [lines()]; state.shapes = [shapes()];
  byId("coordinate").value = "1"; byId("coordinate").dispatchEvent(new Event("change"));
  state.lines.push(lines()); state.shapes.push(shapes());
  state.buttons = [...document.querySelectorAll(".modebar-btn")].map((b) => b.getAttribute("data-title"));
  const table = byId("std-table"), first = () => table.tBodies[0].rows[0].cells[0].textContent;
  const sort = table.tHead.querySelectorAll("button")[2];
  state.first = [first()];
  for (let k = 0; k < 2; k++) { sort.click(); state.first.push(first()); }
  const result = document.createElement("output"); result.id = "result"; result.textContent = JSON.stringify(state);
  document.body.append(result);
}
drive();
</script>
"""


@cache
def html_of(kind: str) -> str:
    make = {
        "plain": trajectory,
        "broken": broken,
        "hostile": lambda: hostile(trajectory()),
    }
    return preview_html(make[kind]() if kind in make else trajectory(kind))


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> dict:
    return BROWSER.drive(
        tmp_path_factory.mktemp("driven"), html_of("plain"), DRIVER, "1280,5000"
    )


@pytest.mark.parametrize(
    "kind",
    [
        "hostile",
        pytest.param("broken", marks=pytest.mark.slow),
        pytest.param("scara", marks=pytest.mark.slow),
    ],
)
def test_draws_without_complaint(kind: str, tmp_path: Path) -> None:
    """Plots are there, the console is silent, and nothing from a file became an element."""
    assert BROWSER.drawn(tmp_path, html_of(kind), "1280,5000") == 3


def test_the_robot_moves_and_stops(driven: dict) -> None:
    start, playing, stopped, later, chosen = driven["times"]
    assert driven["stays"]
    assert driven["moves"]
    assert driven["label"] == "pause"
    assert start == 0 < playing < stopped == later < 6
    assert driven["stops"]
    assert driven["slides"]
    assert chosen == pytest.approx(3)
    assert driven["clock"] == "3.00 s"


def test_positions_are_read_out(driven: dict) -> None:
    run = trajectory().trajectory
    for texts, time in zip(driven["now"], (0.0, 3.0), strict=True):
        shown = [float(text.replace("−", "-")) for text in texts]
        assert np.allclose(shown, run([time])[0], atol=6e-4)


def test_the_view_can_be_changed(driven: dict) -> None:
    """Dragging, wheel, keys, names and path each change the picture; 0 brings the first view back."""
    assert driven["views"] == 6
    assert driven["released"]
    assert driven["reset"]


def test_plots_follow(driven: dict) -> None:
    run = trajectory().trajectory
    left, width = driven["inside"]
    assert driven["head"] == pytest.approx(left + width * 3 / 6, abs=1.5)
    every, one = driven["lines"]
    assert [name for name, _ in every] == ["j1", "j2"] * 3
    assert [name for name, _ in one] == ["position", "velocity", "acceleration"]
    assert driven["shapes"] == [[100, -100] * 3, [-2.5, 2.5, -2, 2, -20, 20]]
    time = [6.0 * 100 / 1400]  # 200 samples in the period of the seventh harmonic
    assert [y for _, y in one] == pytest.approx(
        [run(time, order)[0, 1] for order in range(3)], rel=1e-5
    )
    assert every[1][1] == pytest.approx(100 * run(time)[0, 1] / 2.5, rel=1e-5)


def test_no_button_talks_to_a_server(driven: dict) -> None:
    check_buttons(driven["buttons"])


def test_tables_are_sorted(driven: dict) -> None:
    order = np.argsort(trajectory().conditioning.std) + 1
    assert driven["first"] == ["1", str(order[0]), str(order[-1])]


def test_no_wider_than_its_window(driven: dict) -> None:
    assert driven["wide"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("width", [390, 700])
def test_fits_narrow_screens(width: int, tmp_path: Path) -> None:
    """Inside a frame, because windows cannot be that narrow."""
    measure = """<script>
      setTimeout(() => parent.postMessage(document.documentElement.scrollWidth - innerWidth, "*"), 2000);
      </script></body>"""
    (tmp_path / "inner.html").write_text(
        html_of("broken").replace("</body>", measure), encoding="utf-8"
    )
    outer = f"""<!DOCTYPE html><html><head></head><body>
      <script>addEventListener("message", (event) => {{ document.title = event.data; }});</script>
      <iframe src="inner.html" width="{width}" height="4000"></iframe></body></html>"""
    dom, said = BROWSER.browse(tmp_path, outer, "--window-size=800,4200", "--dump-dom")
    assert said == []
    assert "<title>0</title>" in dom


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 500])
def test_no_part_is_blank(width: int, tmp_path: Path) -> None:
    picture = BROWSER.picture(tmp_path, html_of("panda"), f"{width},5000")
    for start in range(0, 4000, 500):
        assert picture[start : start + 500].std() > 3


@pytest.mark.slow
def test_prints(tmp_path: Path) -> None:
    paper = BROWSER.printed(tmp_path, html_of("plain"))
    assert paper.startswith(b"%PDF")
    assert len(paper) > 60_000
