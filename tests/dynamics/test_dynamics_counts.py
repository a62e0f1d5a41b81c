"""How many additions and multiplications the functions of robots need for a sample.

Published counts of customised Newton–Euler with base parameters: Stäubli RX90 238 and 253 (Khalil and Dombre), 228 and
298 (SymPyBotics); PUMA 560 325 and 431, UR10 338 and 444 (SymPyBotics).
"""

from __future__ import annotations

import pytest

import echelon as ec
from echelon.dynamics.functions import FUNCTIONS, inverse_dynamics, robot_function
from echelon.dynamics.outputs import RecordedOutputs
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Function
from support import textbook_arms as arms
from support.paths import EXAMPLES

NAME = "inverse_dynamics"
COUNTS = {
    "rx90": {
        "inverse_dynamics": (225, 238, 5),
        "gravity": (25, 40, 5),
        "mass_matrix": (112, 132, 5),
        "inverse_dynamics_derivatives": (896, 1024, 5),
    },
    "puma560": {
        "inverse_dynamics": (236, 248, 5),
        "gravity": (25, 40, 5),
        "mass_matrix": (130, 148, 5),
        "inverse_dynamics_derivatives": (974, 1106, 5),
    },
    "panda": {
        "inverse_dynamics": (294, 298, 6),
        "gravity": (34, 50, 6),
        "mass_matrix": (175, 196, 6),
        "inverse_dynamics_derivatives": (1273, 1439, 6),
    },
    "ur10": {
        "inverse_dynamics": (232, 244, 5),
        "gravity": (25, 40, 5),
        "mass_matrix": (128, 146, 5),
        "inverse_dynamics_derivatives": (938, 1067, 5),
    },
}
"""Additions and subtractions, multiplications, and pairs of sine and cosine."""

UR10 = ("R 0 0 0", "R pi/2 0 0", "R 0 a2 0", "R 0 a3 d4", "R pi/2 0 d5", "R -pi/2 0 0")
ARMS = {
    "rx90": arms.rx90(),
    "puma560": arms.puma560(),
    "panda": arms.panda(),
    "ur10": arms.modified_dh("ur10", *UR10, values={"a2": "-0.612", "a3": "-0.5723", "d4": "0.163941", "d5": "0.1157"}),
}


def counted(function: Function) -> tuple[int, int, int]:
    operations = function.operations()
    assert operations.keys() <= {"ADD", "SUB", "MUL", "NEG", "SIN", "COS"}
    return operations["ADD"] + operations["SUB"], operations["MUL"], operations["SIN"]


@pytest.mark.parametrize("robot", ARMS)
@pytest.mark.parametrize("name", COUNTS["rx90"])
def test_base_parameters(robot: str, name: str) -> None:
    mechanism, limits = ARMS[robot], COUNTS[robot][name]
    found = counted(robot_function(name, mechanism, ec.base_parameters(mechanism).matrix.pivots))
    assert all(a <= b for a, b in zip(found, limits, strict=True)), found


@pytest.mark.parametrize("robot", ARMS)
def test_standard_parameters_cost_the_same(robot: str) -> None:
    mechanism: Mechanism = ARMS[robot]
    found = counted(robot_function("inverse_dynamics", mechanism, range(len(mechanism.parameters))))
    assert all(a <= b for a, b in zip(found, COUNTS[robot]["inverse_dynamics"], strict=True)), found


def test_frames_behind_constant_placements_cost_the_same() -> None:
    """Standard and modified Denavit–Hartenberg frames of one arm."""
    mechanism = ec.load(EXAMPLES / "ur10.yaml")
    found = counted(robot_function("inverse_dynamics", mechanism, ec.base_parameters(mechanism).matrix.pivots))
    assert all(a <= b for a, b in zip(found, COUNTS["ur10"]["inverse_dynamics"], strict=True)), found


def test_angles_are_summed_only_where_that_pays() -> None:
    """A planar arm needs no sums, because nothing lies across its axes; UR10's wrist turns by a sum of three angles."""
    planar, arm = arms.planar(3), ARMS["ur10"]
    for mechanism in (planar, arm):
        columns = range(len(mechanism.parameters))
        without, chosen = (
            counted(build(mechanism, columns))
            for build in (lambda *given: inverse_dynamics(RecordedOutputs(*given, sums=False)), FUNCTIONS[NAME])
        )
        assert (sum(chosen) < sum(without)) == (mechanism is arm)
