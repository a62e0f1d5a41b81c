"""Trajectories as messages of ROS: YAML as other programs read it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from echelon.excite.files.samples import sampled, yaml_text
from echelon.excite.files.trajectory_file import write_trajectory
from echelon.excite.problem.trajectory import Fourier, Trajectory
from support.trajectory_motions import KIND, NAMES, UNITS, smooth

STORE = get_typestore(Stores.ROS2_HUMBLE)


def test_yaml_is_the_message_that_ros_takes(tmp_path: Path) -> None:
    """Every field of the type and no other, numbers as numbers: what ``ros2 topic pub`` sets by name."""
    there = smooth(1.0)
    there.coefficients[:, 1] *= 1e-7  # written with exponents
    write_trajectory(there, tmp_path / "run.yaml", 300)
    message = yaml.safe_load((tmp_path / "run.yaml").read_text())
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert message["joint_names"] == list(NAMES)
    assert list(message) == ["header", "joint_names", "points"]
    fields = STORE.fielddefs[f"{KIND}Point"][1]
    for point in message["points"]:
        assert list(point) == [name for name, _ in fields]
        assert point["effort"] == []
        assert set(point["time_from_start"]) == {"sec", "nanosec"}
        assert all(type(value) is int for value in point["time_from_start"].values())
    t = np.arange(301) / 300
    for order, field in enumerate(("positions", "velocities", "accelerations")):
        assert all(type(value) is float for point in message["points"] for value in point[field])
        np.testing.assert_array_equal([point[field] for point in message["points"]], there(t, order))
    times = [point["time_from_start"] for point in message["points"]]
    assert [time["sec"] * 10**9 + time["nanosec"] for time in times] == [round(k * 10**9 / 300) for k in range(301)]
    assert times[-1] == {"sec": 1, "nanosec": 0}


@pytest.mark.parametrize("value", [1e-05, -3e-300, 2e22, 0.0, -5.0])
def test_numbers_of_one_digit_stay_numbers_in_yaml(value: float) -> None:
    rest = Trajectory(("a",), ("m",), Fourier(1.0, 1), np.array([[value], [0.0], [0.0]]))
    points = yaml.safe_load(yaml_text(sampled(rest, 10)))["points"]
    assert [point["positions"] for point in points] == [[value]] * 11


awkward = st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=8)


@settings(max_examples=60, deadline=None)
@given(names=st.lists(awkward, min_size=2, max_size=2, unique=True))
def test_names_of_joints_survive_yaml(names: list[str]) -> None:
    """Those that YAML would take for numbers, truth values or syntax, too."""
    text = yaml_text(sampled(Trajectory(tuple(names), UNITS, smooth().basis, smooth().coefficients), 4))
    assert yaml.safe_load(text)["joint_names"] == names


def test_names_that_yaml_would_convert() -> None:
    test_names_of_joints_survive_yaml.hypothesis.inner_test(["no", "1"])
    test_names_of_joints_survive_yaml.hypothesis.inner_test(["[a, b]: *c", "1e3"])
