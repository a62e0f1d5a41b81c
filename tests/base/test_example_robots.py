"""All valid URDF files of example-robot-data: exact rank against the singular values of Pinocchio's regressor.

Those with few moving bodies are compared with the rank of their numbers in 1024-bit arithmetic, too, in both readings.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.formats.snapping import ANGLE_TOLERANCE, PRECISION
from support import ball_rank as truth
from support import ball_rank_of_urdf as urdf_truth
from support.robot_files import pinocchio_model, robot_file, robot_files
from support.selection import slow_unless

PUBLISHED = {
    "a1": (68, 94),
    "baxter": (103, 131),
    "centauro": (243, 283),
    "g1_29dof_rev_1_0": (189, 213),
    "icub": (212, 234),
    "kinova": (36, 52),
    "panda": (51, 67),
    "pr2": (182, 217),
    "romeo": (361, 395),
    "so100": (36, 52),
    "talos_full_v2": (290, 318),
    "tiago": (310, 343),
    "tiago_dual": (639, 708),
    "ur10_robot": (36, 52),
    "xarm7": (43, 59),
}
LARGE = 9
"""Files with more joints than this, fixed ones included, are slow: the singular values take long, not we."""

EXACTLY = 32
"""Files with at most so many moving joints are evaluated in 1024 bits: the cost grows with the third power."""


def load(file: Path, floating: bool, **options: object) -> ec.Mechanism:
    # Pinocchio ignores mimic elements
    return ec.load(file, floating=floating, independent_mimics=True, **options)  # type: ignore[arg-type]


def test_all_files_are_there() -> None:
    # 69 URDFs, of which ur3.urdf is empty
    assert len(robot_files()) == 68


@pytest.mark.parametrize(
    "name", slow_unless(lambda name: PUBLISHED[name][0] < 70, PUBLISHED)
)
def test_published_counts(name: str) -> None:
    found = tuple(
        ec.base_structure(load(robot_file(name), floating)).rank
        for floating in (False, True)
    )
    assert found == PUBLISHED[name]


def test_so100_literally() -> None:
    """One rounded π/2 makes two spurious parameters; the result names it."""
    base = ec.base_parameters(load(robot_file("so100"), floating=False))
    assert (base.rank, base.reading.literal_rank) == (36, 38)
    assert [snap.element for snap in base.reading.decisive] == [
        "joint 'shoulder_pan' origin roll"
    ]


def svd(file: Path, floating: bool) -> tuple[int, float]:
    """Number of singular values above rounding, columns scaled, and the gap to the next one.

    Rounding is 1e-9 of the largest; a column below 1e-12 of the largest is zero but for cos(π/2) ≠ 0 in the file.
    """
    import pinocchio as pin

    model = pinocchio_model(file, floating)
    data = model.createData()
    rng = np.random.default_rng(1)
    columns = 10 * (model.njoints - 1)
    rows = []
    for _ in range(max(4, 3 * columns // max(1, model.nv))):
        q = pin.integrate(model, pin.neutral(model), rng.uniform(-2, 2, model.nv))
        v, a = rng.uniform(-2, 2, model.nv), rng.uniform(-2, 2, model.nv)
        rows.append(pin.computeJointTorqueRegressor(model, data, q, v, a).copy())
    matrix = np.vstack(rows) if rows and columns else np.zeros((0, 0))
    if not matrix.size:
        return 0, np.inf
    norms = np.linalg.norm(matrix, axis=0)
    seen = norms > 1e-12 * norms.max()
    values = np.linalg.svd(matrix[:, seen] / norms[seen], compute_uv=False)
    found = int((values > 1e-9 * values[0]).sum())
    return found, float(values[found - 1] / max([*values[found:], 1e-17]))


def compare(name: str, floating: bool) -> None:
    file = robot_file(name)
    found, gap = svd(file, floating)
    reading = load(file, floating).reading
    assert reading is not None
    # floating point sees the numbers of the file, rounded angles included
    exact = ec.base_structure(reading.literal()).rank
    if gap < 1e3:
        pytest.skip(
            f"the singular values are ambiguous: gap {gap:.0e} at {found}; exact rank {exact}"
        )
    assert found == exact


def joints(name: str) -> int:
    return robot_files()[name].read_bytes().count(b"<joint ")


CASES = slow_unless(lambda name: joints(name) <= LARGE, robot_files())


@pytest.mark.parametrize(
    "floating", [False, pytest.param(True, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("name", CASES)
def test_rounded_numbers_matter_where_they_are_known_to(
    name: str, floating: bool
) -> None:
    """The two SO-ARM files turn the first joint away from the vertical; everywhere else both readings agree."""
    intended = load(robot_file(name), floating)
    assert intended.reading is not None
    surplus = (
        ec.base_structure(intended.reading.literal()).rank
        - ec.base_structure(intended).rank
    )
    assert surplus == (2 if name in ("so100", "so101") and not floating else 0)


@pytest.mark.parametrize(
    "floating", [False, pytest.param(True, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("name", CASES)
def test_rank_equals_singular_values(name: str, floating: bool) -> None:
    compare(name, floating)


def moving(name: str) -> int:
    return len(
        re.findall(rb"<joint[^>]*type=.(?!fixed)", robot_files()[name].read_bytes())
    )


def true_rank(name: str, floating: bool, tolerance: float) -> int:
    bodies = urdf_truth.bodies_of(robot_file(name), floating, tolerance)
    return truth.rank(bodies, truth.vector(0, 0, truth.number("-9.81")))


@pytest.mark.parametrize(
    "name",
    slow_unless(
        ["double_pendulum", "so100"],
        ["double_pendulum", "finger_edu", "ur10_robot", "so100"],
    ),
)
def test_both_readings_of_small_robots_are_the_true_ones(name: str) -> None:
    mechanism = load(robot_file(name), floating=False)
    assert mechanism.reading is not None
    assert ec.base_structure(mechanism).rank == true_rank(name, False, ANGLE_TOLERANCE)
    assert ec.base_structure(mechanism.reading.literal()).rank == true_rank(
        name, False, PRECISION
    )


@pytest.mark.slow
@pytest.mark.parametrize("floating", [False, True])
@pytest.mark.parametrize(
    "name", [name for name in robot_files() if moving(name) <= EXACTLY]
)
def test_both_readings_are_the_true_ones(name: str, floating: bool) -> None:
    mechanism = load(robot_file(name), floating)
    assert mechanism.reading is not None
    assert ec.base_structure(mechanism).rank == true_rank(
        name, floating, ANGLE_TOLERANCE
    )
    assert ec.base_structure(mechanism.reading.literal()).rank == true_rank(
        name, floating, PRECISION
    )
