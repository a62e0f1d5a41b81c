"""The preview of a trajectory: its numbers are those of the result, names stay text, and nothing is loaded."""

from __future__ import annotations

import json
import re
import sys
from base64 import b64decode
from dataclasses import replace
from math import inf, nan

import numpy as np
import numpy.typing as npt
import pytest

import echelon as ec
from echelon.excite.excite import ExcitingTrajectory, MotionConditioning
from echelon.excite.problem.task import changed, task_of
from echelon.excite.problem.trajectory import Fourier, Trajectory
from echelon.excite.verify import Margin
from echelon.report.drawing import pose_at
from echelon.report.page import plotly_source, significant
from echelon.report.preview import TITLES, preview_html, scene
from echelon.shared.errors import MissingExtraError
from support.paths import EXAMPLES
from support.preview_pages import broken, hostile, trajectory
from support.report_data import Page
from support.selection import slow_unless

Floats = npt.NDArray[np.float64]


def numbers(text: str) -> Floats:
    return np.frombuffer(b64decode(text), dtype="<f4").astype(float)


def rows_of(html: str, table: str) -> list[list[str]]:
    """Texts of the cells of a table's body."""
    body = re.search(rf'id="{table}".*?<tbody>(.*?)</tbody>', html, re.DOTALL)
    assert body
    rows = re.findall(r"<tr.*?</tr>", body[1], re.DOTALL)
    return [
        [Page(cell).words for cell in re.findall(r"<t[dh].*?</t[dh]>", row, re.DOTALL)]
        for row in rows
    ]


@pytest.fixture(scope="module")
def html() -> str:
    return preview_html(trajectory())


@pytest.fixture(scope="module")
def page(html: str) -> Page:
    return Page(html)


# -- the page ----------------------------------------------------------------------------------------------------------


def test_same_input_same_page(html: str) -> None:
    trajectory.cache_clear()
    assert preview_html(trajectory()) == html


def test_everything_is_there(page: Page) -> None:
    anchors = [
        attributes["id"] for _, attributes in page.elements if "id" in attributes
    ]
    assert {*TITLES} | {"top", "page-data"} <= set(anchors)
    assert len(anchors) == len(set(anchors))
    assert page.open == []


@pytest.mark.parametrize("make", [trajectory, broken])
def test_nothing_is_loaded(make) -> None:
    """References lead into the page itself, and its policy forbids all others."""
    html = preview_html(make())
    page = Page(html)
    for tag, attributes in page.elements:
        assert tag not in ("link", "iframe", "img", "object", "embed", "base")
        for name, value in attributes.items():
            if name in ("href", "src", "action", "data"):
                assert (value or "").startswith("#"), (tag, name, value)
    own = html.replace(str(plotly_source()), "")
    assert not re.search(r"https?://|url\(|@import|\bfetch\(|XMLHttp|\bimport\b", own)
    policy = next(
        a["content"]
        for t, a in page.elements
        if a.get("http-equiv") == "Content-Security-Policy"
    )
    assert policy is not None
    assert policy.startswith("default-src 'none';")


def test_size() -> None:
    html = preview_html(trajectory("panda"))
    assert html.count(str(plotly_source())) == 1
    assert len(html.encode()) < 6e6
    long = preview_html(trajectory("double_pendulum", duration=600.0))
    assert len(long.encode()) < 6e6


def test_hostile_names_never_become_markup(page: Page) -> None:
    dirty = Page(preview_html(hostile(trajectory())))
    assert {tag for tag, _ in dirty.elements} <= {tag for tag, _ in page.elements}
    known = {name for _, attributes in page.elements for name in attributes}
    assert {name for _, attributes in dirty.elements for name in attributes} <= known
    assert dirty.open == []
    assert len(dirty.scripts) == 3
    assert dirty.scripts[1:] == page.scripts[1:]
    assert dirty.words.count("<script>alert(1)</script>") > 20  # shown, as text
    assert dirty.words.count("</script><b>j1") >= 3
    names = [
        coordinate["name"]
        for coordinate in json.loads(dirty.scripts[0])["motion"]["coordinates"]
    ]
    assert names == ["</script><b>j1", "</script><b>j2"]


def test_without_plotly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    with pytest.raises(MissingExtraError, match="plotly"):
        preview_html(trajectory())


@pytest.mark.parametrize(
    "robot",
    slow_unless(
        ["floating_tree", "cart_pole", "gripper_coupled"],
        ["scara", "gripper_coupled", "floating_tree", "cart_pole", "tx40"],
    ),
)
def test_any_robot(robot: str) -> None:
    """Sliding, coupled, held and floating ones."""
    page = Page(preview_html(trajectory(robot)))
    assert page.open == []
    assert json.loads(page.scripts[0])["robot"] is not None


# -- the header --------------------------------------------------------------------------------------------------------


def test_verdict_when_all_is_well(page: Page) -> None:
    found = trajectory()
    assert found.safe
    assert "Every limit is kept at every time." in page.words
    assert "✗" not in page.words
    for number in (
        found.conditioning.condition,
        found.conditioning.scaled_condition,
        found.conditioning.log_det,
    ):
        assert significant(number) in page.words


def test_broken_limits_come_before_all_else() -> None:
    words = Page(preview_html(broken())).words
    total = len(trajectory().margins) + 4
    assert f"Do not run this: 2 of {total} limits are broken." in words
    assert "Every limit is kept" not in words
    order = [
        "Do not run this",
        "✗ broken torque of j1",
        "no limits of torques",
        "has no jerk limit",
    ]
    places = [words.index(text) for text in order]
    assert places == sorted(places)
    assert "reaches −31.75 … 12.00 N·m ; allowed are −30.00 … 30.00 N·m" in words


def test_no_limits_are_no_safety() -> None:
    page = Page(preview_html(replace(trajectory(), margins=())))
    assert "No limit is checked." in page.words
    assert "Every limit is kept" not in page.words
    assert not any("good" in (a.get("class") or "").split() for _, a in page.elements)


def test_what_is_not_seen_is_said() -> None:
    found = trajectory()
    blind = MotionConditioning(
        inf, inf, -inf, (inf,) * found.base.rank, ((3.0, inf), (6.0, inf))
    )
    page = Page(preview_html(replace(found, conditioning=blind)))
    assert "does not determine all base parameters" in page.words
    json.loads(page.scripts[0], parse_constant=lambda name: pytest.fail(name))
    assert not re.search(r"\b(nan|inf)\b", page.words)


def test_held_coordinates_are_named() -> None:
    assert "upper_arm at 0" in Page(preview_html(trajectory("floating_tree"))).words


# -- tables ------------------------------------------------------------------------------------------------------------


def test_margins_are_those_of_the_result() -> None:
    found = broken()
    rows = rows_of(preview_html(found), "margin-table")
    assert len(rows) == len(found.margins)
    for margin in found.margins:
        row = next(r for r in rows if r[0] == margin.label)
        assert row[2:4] == [significant(margin.margin, 3), margin.unit]
        assert row[4] == significant(100 * margin.relative, 3)
        if margin.high == inf:
            assert row[5] == f"≥ {significant(margin.low)}"
            continue
        assert row[5] == f"{significant(margin.low)} … {significant(margin.high)}"
        assert row[6] == f"{significant(margin.least)} … {significant(margin.largest)}"


def test_margins_by_urgency() -> None:
    """By hand: −1.75/60 and −0.25/60 are broken, 0.125/80 is within 2 %."""
    rows = rows_of(preview_html(broken()), "margin-table")
    assert [r[0] for r in rows[:2]] == ["torque of j1", "torque of j3"]
    assert [r[1] for r in rows[:2]] == ["✗ broken", "✗ broken"]
    near = [r for r in rows if r[1] == "● near"]
    assert ["torque of j2", "● near", "0.125", "N·m", "0.156"] in [r[:5] for r in near]
    assert [r[1] for r in rows] == sorted(
        (r[1] for r in rows), key=["✗ broken", "● near", "kept"].index
    )
    assert rows[2 : 2 + len(near)] == near
    height = next(r for r in rows if r[0] == "height of hand")
    assert height[5:7] == ["≥ 0.1250", "0.5000 … 1.500"]


def test_margins_that_are_not_numbers_count_as_broken() -> None:
    strange = Margin("distance", "m", 0.0, inf, nan, nan)
    rows = rows_of(
        preview_html(replace(trajectory(), margins=(*trajectory().margins, strange))),
        "margin-table",
    )
    assert rows[0][:3] == ["distance", "✗ broken", "−∞"]


def test_deviations_are_those_of_the_result(html: str, page: Page) -> None:
    found = trajectory()
    rows = rows_of(html, "std-table")
    assert [r[2] for r in rows] == [
        significant(std, 3) for std in found.conditioning.std
    ]
    assert [r[3] for r in rows] == list(found.base.units)
    keys = re.findall(r'<th scope="row" class="name form" data-key="(.*?)"', html)
    assert keys == [str(expression) for expression in found.base.expressions]
    assert "0.250 , SI units" in page.words


def test_deviations_against_the_robot_file() -> None:
    """Per cent of values that the file states, where it states any."""
    found = trajectory()
    first = found.base.mechanism.bodies[0]
    assert first.inertial is None
    inertial = (0.25, 0.0, 0.0, 0.25, 0.0, 0.25, 0.5, 0.125, 0.0, 2.0)
    bodies = tuple(
        replace(body, inertial=inertial) for body in found.base.mechanism.bodies
    )
    values = tuple(
        replace(effect, value=1.0) for effect in found.base.mechanism.effects
    )
    base = replace(
        found.base,
        mechanism=replace(found.base.mechanism, bodies=bodies, effects=values),
    )
    std = tuple(0.1 * abs(value) for value in base.values())
    rows = rows_of(
        preview_html(
            replace(found, base=base, conditioning=replace(found.conditioning, std=std))
        ),
        "std-table",
    )
    # MY2 is stated as 0.125 and is a base parameter of its own
    row = next(
        r
        for r, expression in zip(rows, base.expressions, strict=True)
        if str(expression) == "MY2"
    )
    assert row[4:] == ["0.1250", "10"]


def test_starts(page: Page) -> None:
    assert "3 starts, 1 of which found no motion that keeps the limits." in page.words
    assert (
        "0 optimal −12.346 best 31 1 no motion keeps the limits ∞ 7 2 iterations −11.500 100"
        in page.words
    )
    assert [s["history"] for s in json.loads(page.scripts[0])["starts"]] == [
        [3.5, -4.25, -12.345678],
        [],
        [1.5, -11.5],
    ]


def test_settings_are_json(html: str) -> None:
    """Readable by others: limits that do not exist are none, as in set-ups."""
    text = re.search(r"<pre>(.*?)</pre>", html, re.DOTALL)
    assert text
    read = json.loads(
        text[1].replace("&#34;", '"'), parse_constant=lambda name: pytest.fail(name)
    )
    assert read["excitation"] == {
        "noise": {"all": 0.25},
        "limits": {"effort": {"j1": "none"}},
    }


# -- plots and picture -------------------------------------------------------------------------------------------------


def test_plotted_motion_is_the_trajectory(page: Page) -> None:
    run = trajectory().trajectory
    motion = json.loads(page.scripts[0])["motion"]
    assert [c["name"] for c in motion["coordinates"]] == list(run.coordinates)
    for k, coordinate in enumerate(motion["coordinates"]):
        for order, signal in enumerate(coordinate["orders"]):
            time, values = numbers(signal["time"]), numbers(signal["values"])
            assert time[0] == 0
            assert time[-1] == pytest.approx(6.0)
            assert (
                np.abs(values - run(time, order)[:, k]).max()
                < 1e-4 * np.abs(values).max()
            )
        assert [signal["unit"] for signal in coordinate["orders"]] == [
            "rad",
            "rad/s",
            "rad/s²",
        ]
        assert [coordinate["orders"][0][end] for end in ("low", "high")] == [-2.5, 2.5]
        assert [coordinate["orders"][1][end] for end in ("low", "high")] == [-2.0, 2.0]


def test_missing_limits_are_named() -> None:
    found = trajectory()
    page = Page(preview_html(replace(found, margins=found.margins[1:])))
    assert found.margins[0].label == "position of j1"
    assert "Without limits: position of j1 ." in page.words
    assert (
        json.loads(page.scripts[0])["motion"]["coordinates"][0]["orders"][0]["low"]
        is None
    )


def test_plotted_conditioning(page: Page) -> None:
    """Where it is infinite there is no point."""
    kept = [
        moment
        for moment in trajectory().conditioning.over_time
        if np.isfinite(moment[1])
    ]
    plotted = json.loads(page.scripts[0])["conditioning"]
    assert list(zip(plotted["time"], plotted["condition"], strict=True)) == kept


@pytest.mark.parametrize(
    "robot", ["panda", "scara", "gripper_coupled", "floating_tree", "tx40"]
)
def test_pictures_agree_with_single_poses(robot: str) -> None:
    """Frames and axes are those that the report's drawing finds, pose by pose, in another way."""
    found = trajectory(robot)
    view = scene(found)
    mechanism, names = found.base.mechanism, found.trajectory.coordinates
    for k in (0, len(view.time) // 3, len(view.time) - 1):
        state = dict(
            zip(names, found.trajectory([view.time[k]])[0].tolist(), strict=True)
        )
        pose = pose_at(
            mechanism, np.array([state[name] for name in mechanism.positions])
        )
        assert np.allclose(view.origins[k], pose.origins, atol=1e-12)
        assert np.allclose(view.axes[k], pose.axes, atol=1e-12)
    assert np.allclose(view.up, pose.up)


def test_pictures_of_a_pendulum() -> None:
    """By hand: links of 0.3 m that hang, angles measured from the x axis; gravity decides where up is."""
    found = trajectory()
    robot = json.loads(Page(preview_html(found)).scripts[0])["robot"]
    origins = numbers(robot["origins"]).reshape(robot["pictures"], 2, 3)
    time = np.linspace(0, 6, robot["pictures"])
    q = found.trajectory(time)[:, 0]
    assert np.allclose(
        origins[:, 1], 0.3 * np.stack([np.cos(q), np.sin(q), 0 * q], axis=1), atol=1e-6
    )
    assert robot["pictures"] == 181  # 30 a second
    assert np.allclose(numbers(robot["q"]).reshape(-1, 2)[:, 0], q, atol=1e-6)
    assert [body["joint"] for body in robot["bodies"]] == ["turn", "turn"]


def test_stubs_turn_with_their_bodies() -> None:
    """Rigid: a stub has one length, and one direction in the frame of its body."""
    view = scene(trajectory("scara"))
    lengths = np.linalg.norm(view.tips[:, 0] - view.origins[:, view.last[0]], axis=1)
    assert np.ptp(lengths) < 1e-12
    pendulum = scene(trajectory())
    q = trajectory().trajectory(pendulum.time).sum(axis=1)
    stub = pendulum.tips[:, 0] - pendulum.origins[:, 1]
    assert np.allclose(
        stub / np.linalg.norm(stub[0]),
        np.stack([np.cos(q), np.sin(q), 0 * q], axis=1),
        atol=1e-9,
    )


def test_bodies_that_do_not_move_are_drawn() -> None:
    found = trajectory("floating_tree")
    view = scene(found)
    names = [body.name for body in found.base.mechanism.bodies]
    assert [n for n, still in zip(names, view.still, strict=True) if still] == [
        "base",
        "upper_arm",
    ]
    words = Page(preview_html(found)).words
    assert "These bodies do not move: base , upper_arm ." in words


def test_no_picture_without_lengths() -> None:
    """The rest of the page is there, and says why."""
    found = trajectory()
    symbols = {
        name: replace(symbol, value=None)
        for name, symbol in found.base.mechanism.symbols.items()
    }
    base = replace(found.base, mechanism=replace(found.base.mechanism, symbols=symbols))
    page = Page(preview_html(replace(found, base=base)))
    assert "There is no picture: symbol 'l1' has no value" in page.words
    assert json.loads(page.scripts[0])["robot"] is None
    assert page.open == []


def test_loops_are_drawn_closed() -> None:
    """The rocker's pin of a four-bar stays where the coupler is, in every picture."""
    setup = ec.load_setup(EXAMPLES / "loops" / "four_bar.yaml")
    task = task_of(setup, changed(setup.excitation, {"duration": 4.0}, setup.source))
    run = Trajectory(
        task.mechanism.independent_velocities,
        task.limits.units,
        Fourier(4.0, 1),
        np.array([[0.0], [0.3], [0.0]]),
    )
    found = ExcitingTrajectory(
        run, task.base, {}, "d_optimal", MotionConditioning(1.0, 1.0, 0.0, (1.0,) * task.base.rank, ()), (), (), (), {}
    )  # fmt: skip
    view = scene(found)
    lengths = np.linalg.norm(np.diff(view.origins, axis=1), axis=2)
    assert np.ptp(view.origins, axis=0).max() > 0.01
    chain = [
        k for k, body in enumerate(task.mechanism.bodies) if body.parent == k - 1 and k
    ]
    assert np.ptp(lengths[:, [k - 1 for k in chain]], axis=0).max() < 1e-9
