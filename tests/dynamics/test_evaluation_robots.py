"""Standard and base regressors of all URDF files of example-robot-data, by machine code, against Pinocchio's."""

from __future__ import annotations

import re

import numpy as np
import pytest

import echelon as ec
from echelon.dynamics.evaluator import Evaluator
from echelon.dynamics.functions import robot_function
from support.float_regressor import random_states
from support.pinocchio_regressor import pinocchio_regressor
from support.robot_files import pinocchio_model, robot_file, robot_files
from support.selection import slow_unless

FEW = 5
"""Files with more moving joints are slow: compiling takes some seconds."""

SAMPLES = 11
"""More than one vector of samples, and part of another."""

ALIKE = ("talos_full", "talos_reduced")
"""Files with angles, -1.57079632679 and 4.71238898038, whose distances from a quarter turn differ by 2e-13 and are read
as one number."""


def joints(name: str) -> int:
    return len(
        re.findall(
            rb"type\s*=\s*[\"'](?:revolute|continuous|prismatic)[\"']",
            robot_files()[name].read_bytes(),
        )
    )


def cases() -> list[object]:
    return slow_unless(lambda name: joints(name) <= FEW, robot_files())


def test_some_files_are_fast() -> None:
    assert sum(joints(name) <= FEW for name in robot_files()) >= 10


@pytest.mark.parametrize("floating", slow_unless([False], [False, True]))
@pytest.mark.parametrize("name", cases())
def test_regressors_equal_pinocchio(name: str, floating: bool) -> None:
    # nothing is snapped, so both programs see the numbers of the file; Pinocchio ignores mimic elements
    mechanism = ec.load(
        robot_file(name), floating=floating, snap_tolerance=0, independent_mimics=True
    )
    state = random_states(mechanism, SAMPLES)
    expected = pinocchio_regressor(
        mechanism, pinocchio_model(robot_file(name), floating), *state
    )
    for columns in (
        range(len(mechanism.parameters)),
        ec.base_structure(mechanism).pivots,
    ):
        evaluate = Evaluator(mechanism, robot_function("regressor", mechanism, columns))
        found = evaluate(dict(zip(("q", "qd", "qdd"), state, strict=True)))
        # reached: 5.3e-13 for those files, 2.4e-14 (Romeo) for all others
        tolerance = 1e-12 if name.startswith(ALIKE) else 5e-14
        scale = np.abs(expected).max(initial=0)
        np.testing.assert_allclose(
            found, expected[:, :, list(columns)], rtol=0, atol=tolerance * scale
        )
