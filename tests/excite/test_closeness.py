"""Distances along a motion and on the way to where it begins, against geometry by hand, and what the preview shows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import echelon as ec
from echelon.excite.excite import ExcitingTrajectory
from echelon.excite.problem.trajectory import Fourier, Trajectory
from echelon.report.preview import preview_html, scene
from support.report_data import Page

Floats = npt.NDArray[np.float64]

ARM = """
echelon: 1
name: arm
symbols: {l1: 0.4}
gravity: GRAVITY
modified_dh:
  - {joint: revolute, inertial: {mass: 4, com: [0.1, 0, 0], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}}
  - {joint: revolute, a: l1, inertial: {mass: 3, com: [0.2, 0, 0], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}}
excitation:
  limits: {position: [-3, 3], velocity: 3}
  collisions:
    clearance: 0.05
    shapes:
      - {body: j1, capsule: 0.05, from: [0, 0, 0], to: [0.4, 0, 0]}
      - {body: j2, sphere: 0.1, at: [0.3, 0, 0]}
    obstacles:
      - {name: post, sphere: 0.1, at: POST}
      - {name: mast, sphere: 0.1, at: [0, 0, 0.5]}
      - {name: tower, sphere: 0.1, at: [0, 0, 9]}
"""
FLOATING = """<robot name="arm"><link name="base"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0"
ixz="0" iyz="0"/></inertial></link><link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0"
ixz="0" iyz="0"/></inertial></link><joint name="j" type="revolute"><parent link="base"/><child link="a"/>
<origin xyz="0 0 -0.5"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2" effort="9"/></joint></robot>"""
START, SWING = np.array([1.2, 0.4]), np.array([0.2, -0.3])
DURATION = 4.0


def motion(
    folder: Path, post: str, gravity: str = "[0, 0, -9.81]"
) -> ExcitingTrajectory:
    """Both joints swing once about the pose where they begin."""
    file = folder / "arm.yaml"
    file.write_text(ARM.replace("POST", post).replace("GRAVITY", gravity))
    coefficients = np.array([START, SWING, np.zeros(2)])
    run = Trajectory(("j1", "j2"), ("rad", "rad"), Fourier(DURATION, 1), coefficients)
    return ec.judged_trajectory(ec.load_setup(file), run)


def away(q: Floats, post: Floats) -> Floats:
    """Distance of the ball on the second link and the post, for joints of shape (N, 2)."""
    first, both = q[:, 0], q.sum(axis=1)
    x = 0.4 * np.cos(first) + 0.3 * np.cos(both)
    y = 0.4 * np.sin(first) + 0.3 * np.sin(both)
    found: Floats = np.hypot(x - post[0], y - post[1]) - 0.2
    return found


def test_distances_over_time(tmp_path: Path) -> None:
    found = motion(tmp_path, "[-0.35, 0.75, 0]")
    assert found.closeness is not None
    time, pairs = (
        found.closeness.time,
        {pair.label: pair for pair in found.closeness.pairs},
    )
    assert (time[0], time[-1], len(time)) == (0.0, DURATION, 201)
    post = pairs["distance of j2 and post"]
    q = START + SWING * np.sin(2 * np.pi * time / DURATION)[:, None]
    expected = np.minimum(away(q, np.array([-0.35, 0.75])), 1.0)
    np.testing.assert_allclose(post.distance, expected, atol=1e-6)
    assert (post.obstacle, post.low, post.steady) == (True, 0.05, False)
    mast = pairs["distance of j1 and mast"]
    assert mast.steady
    assert mast.least == pytest.approx(0.35, abs=1e-6)
    nearest = [pair.least - pair.low for pair in found.closeness.pairs]
    assert nearest == sorted(nearest)


@pytest.mark.parametrize("post", [(0.6, 0.35), (-0.35, 0.75)])
def test_the_way_to_where_a_motion_begins(
    tmp_path: Path, post: tuple[float, float]
) -> None:
    found = motion(tmp_path, f"[{post[0]}, {post[1]}, 0]")
    (text,) = [f.text for f in found.findings if f.kind == "beginning"]
    assert text.startswith("the motion begins at j1 = 1.2 rad, j2 = 0.4 rad: ")
    way = START * np.linspace(0, 1, 201)[:, None]
    least = away(way, np.array(post)).min()
    if least >= 0.05:
        assert text.endswith(
            "the straight way of the joints from zero keeps all distances"
        )
    else:
        assert text.endswith(
            f"% of it it is {1e3 * (0.05 - least):.3g} mm less than 0.05 m"
        )


def test_the_preview_shows_distances_and_shapes(tmp_path: Path) -> None:
    found = motion(tmp_path, "[-0.35, 0.75, 0]")
    page = Page(preview_html(found))
    data = json.loads(page.scripts[0])
    (to_obstacles,) = data["distances"]["groups"]
    names = [pair["name"] for pair in to_obstacles]
    assert names[0] == "j2 and post"
    assert set(names) == {"j2 and post", "j1 and post", "j2 and mast"}
    assert (
        "The motion hardly changes these distances: j1 and mast 0.350 m" in page.words
    )
    assert "The motion begins at j1 = 1.2 rad, j2 = 0.4 rad" in page.words
    assert "j1 and tower" in page.words  # among the limits
    view = scene(found)
    for k, shape in enumerate(view.shapes):
        x, y = view.turned[:, k, 0], view.turned[:, k, 1]
        rotation = np.stack([x, y, np.cross(x, y)], axis=-1)
        place = view.origins[:, shape.body] + rotation @ shape.placement[:3, 3]
        first = START[0] + SWING[0] * np.sin(2 * np.pi * view.time / DURATION)
        if shape.body == 0:  # the middle of the capsule
            by_hand = 0.2 * np.stack([np.cos(first), np.sin(first)], axis=-1)
            np.testing.assert_allclose(place[:, :2], by_hand, atol=1e-12)
    assert [one["name"] for one in data["robot"]["obstacles"]] == [
        "post",
        "mast",
        "tower",
    ]
    assert [one["body"] for one in data["robot"]["shapes"]] == [0, 1]


def test_limits_with_one_end_say_at_least(tmp_path: Path) -> None:
    found = motion(tmp_path, "[-0.35, 0.75, 0]")
    margin = next(m for m in found.margins if m.label == "distance of j2 and post")
    words = Page(preview_html(found)).words
    assert f"≥ 0.05000 at least {margin.least:.4g}" in words
    (text,) = [f.text for f in found.findings if f.kind == "limits"]
    # of ±3 rad the first joint reaches 1.4, and of 3 rad/s the second one 0.3 · 2π/4
    assert "position 46.7 % (j1), velocity 15.7 % (j2)" in text


@pytest.mark.parametrize(
    ("gravity", "below"),
    [("[0, 9.81, 0]", 0.4 * np.sin(1.4)), ("[0, -9.81, 0]", 0), ("[0, 0, -9.81]", 0)],
)
def test_room_below_the_base_is_named(
    gravity: str, below: float, tmp_path: Path
) -> None:
    found = motion(tmp_path, "[-0.35, 0.75, 0]", gravity)
    texts = [f.text for f in found.findings if f.kind == "room"]
    assert len(texts) == bool(below)
    for text in texts:
        assert text.startswith(f"the origin of 'j2' comes down to {below:.3g} m below")
        assert text.endswith("beside the obstacles 'post', 'mast', 'tower'?")
        assert " ".join(text[1:].split()) in Page(preview_html(found)).words


def test_a_robot_that_floats_has_no_room_to_keep(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(FLOATING)
    setup = tmp_path / "arm.yaml"
    setup.write_text(
        "echelon: 1\nname: arm\nrobot: arm.urdf\nfloating_base: true\nexcitation: {limits: {velocity: 1}}\n"
    )
    run = Trajectory(
        ("j",), ("rad",), Fourier(DURATION, 1), np.array([[0.5], [0.3], [0.0]])
    )
    found = ec.judged_trajectory(ec.load_setup(setup), run)
    assert found.held
    assert [f for f in found.findings if f.kind == "room"] == []
