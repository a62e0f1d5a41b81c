"""Messages of other programs: read where they are right, refused in one clear sentence where they are not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from echelon.errors import InputError
from echelon.excite.files.trajectory_file import read_trajectory
from support.trajectory_motions import NAMES, UNITS, WAVE, T


def message(**others: Any) -> dict[str, Any]:
    points = [
        {"positions": [float(q), 1 - float(q)], "time_from_start": {"sec": 3 + k // 100, "nanosec": k % 100 * 10**7}}
        for k, q in enumerate(WAVE)
    ]
    return {"joint_names": list(NAMES), "points": points} | others


def point(k: int, **others: Any) -> dict[str, Any]:
    points = message()["points"]
    points[k] |= others
    return message(points=points)


def test_positions_alone_make_a_message(tmp_path: Path) -> None:
    """As other programs write it: block lists, three dashes, exponents that YAML 1.1 takes for texts."""
    path = tmp_path / "run.yml"
    text = yaml.safe_dump(message()).replace("- 0.0\n", "- 0e-05\n")
    path.write_text(f"---\n{text}---\n")
    found = read_trajectory(path, NAMES, UNITS)
    assert found.duration == pytest.approx(0.49)
    np.testing.assert_allclose(found(T), np.column_stack([WAVE, 1 - WAVE]), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ([], "not a JointTrajectory with joint_names and points"),
        ({"points": []}, "joint_names: not a JointTrajectory"),
        (message(points=[]), "points: holds no points with positions"),
        (message(points=message()["points"][:5]), "holds 5 samples"),
        (message(points=[7]), "points.0: not a JointTrajectory"),
        (message(joint_names=["j1", "j1"]), "joint_names: a joint occurs twice: 'j1', 'j1'"),
        (message(joint_names=["j1", "b"]), "joint_names: the coordinate 'slider' is missing; there are 'j1', 'b'"),
        (message(joint_names=[*NAMES, "j9"]), "joint_names: there is no coordinate for 'j9'; valid are 'j1', 'slider'"),
        (message(joint_names=[["j1"], "j9"]), "joint_names.0: .* should be a valid string"),
        (point(3, positions=[1.0]), r"points\[3\].positions: holds 1 numbers; needs 2"),
        (point(3, positions=[]), r"points\[3\].positions: holds 0 numbers; needs 2"),
        (point(3, positions=5.0), "points.3.positions: .* should be a valid list"),
        (point(3, positions=["x", 0]), "points.3.positions.0: .* should be a valid number"),
        (point(3, positions=[[1], 0]), "points.3.positions.0: .* should be a valid number"),
        (point(3, positions=[float("nan"), 0]), "points.3.positions.0: .* should be a valid number"),
        (point(0, velocities=[0.0, 0.0]), r"points\[1\].velocities: holds 0 numbers; needs 2"),
        (point(3, time_from_start={"sec": 3, "nanosec": 0}), "column 't', point 3: 3.0 s follows 3.02 s"),
        (point(3, time_from_start={"sec": 3}), "points.3.time_from_start.nanosec: .* required"),
        (point(3, time_from_start={"sec": 10**400, "nanosec": 0}), "points.3.time_from_start.sec: .* less than"),
        (
            message(points=[p | {"velocities": [0.0, 0.0]} for p in message()["points"]]),
            "column 'qd_j1': its velocities are not those of the positions",
        ),
    ],
)
def test_messages_that_are_wrong(content: Any, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "run.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=rf"run\.yaml: {problem}"):
        read_trajectory(path, NAMES, UNITS)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (b"# nothing\n", "holds 0 messages; needs one"),
        (b"a: 1\n---\na: 1\n", "holds 2 messages"),
        (b"a: 1\npoints: [\n", r"not well-formed YAML: .* \(line 2, column 1\)"),
        (b"points: \xff", "not UTF-8"),
        (b"points: \x00", "not readable as YAML"),
        (b"a: !!python/object:os.system {}", "tags such as !!python/object:os.system are not accepted"),
        (b"[" * 100_000 + b"]" * 100_000, "nested too deeply to be a document"),
    ],
)
def test_files_that_are_no_messages(text: bytes, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "run.yaml"
    path.write_bytes(text)
    with pytest.raises(InputError, match=problem):
        read_trajectory(path, NAMES, UNITS)


def test_aliases_cannot_blow_up(tmp_path: Path) -> None:
    """Ten lists of ten of the same list, nine times: a number in name only."""
    lines = ["a0: &a0 [1, 1]", *(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 30))]
    lines += ["joint_names: [j1, slider]", "points: [{positions: [*a29, *a29], time_from_start: {sec: 0, nanosec: 0}}]"]
    (tmp_path / "run.yaml").write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"aliases .* are not accepted"):
        read_trajectory(tmp_path / "run.yaml", NAMES, UNITS)
