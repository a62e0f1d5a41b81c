"""Functions of robots: what they have to do with each other, whatever the mechanism."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import arms
import echelon as ec
from builders import mechanisms
from echelon.dynamics.functions import FUNCTIONS, robot_function
from echelon.errors import InputError
from echelon.mechanism.mechanism import Mechanism
from oracles import FloatArray, random_states
from recorded import evaluate

NAMES = ("inverse_dynamics", "gravity", "coriolis", "effects", "mass_matrix", "regressor")


def results(
    mechanism: Mechanism, pivots: Sequence[int], seed: int = 1, **inputs: FloatArray
) -> tuple[dict[str, FloatArray], FloatArray, FloatArray]:
    """All functions at random states with random parameters; the parameters; the accelerations."""
    q, qd, qdd = random_states(mechanism, 3, seed)
    zeta = np.random.default_rng(seed).normal(size=len(pivots))
    values = {"q": q, "qd": qd, "qdd": qdd, "parameters": zeta, **inputs}
    found = {name: evaluate(robot_function(name, mechanism, pivots), mechanism, values) for name in NAMES}
    return found, zeta, qdd


def check_parts(found: dict[str, FloatArray], zeta: FloatArray, qdd: FloatArray) -> None:
    y = found["inverse_dynamics"]
    size = 1 + np.abs(y).max()
    np.testing.assert_allclose(found["regressor"] @ zeta, y, atol=1e-13 * size)
    parts = found["coriolis"] + found["gravity"] + found["effects"]
    np.testing.assert_allclose(np.einsum("kij,kj->ki", found["mass_matrix"], qdd) + parts, y, atol=1e-13 * size)


@given(mechanisms(), st.integers(0, 2**32))
def test_parts_of_inverse_dynamics(mechanism: Mechanism, seed: int) -> None:
    columns = range(len(mechanism.parameters))
    found, zeta, qdd = results(mechanism, columns, seed)
    check_parts(found, zeta, qdd)
    mass = found["mass_matrix"]
    np.testing.assert_allclose(mass, np.swapaxes(mass, 1, 2), atol=1e-12 * (1 + np.abs(mass).max(initial=0)))


@pytest.mark.parametrize("make", [arms.rx90, arms.puma560, arms.panda, arms.floating_pair])
def test_base_parameters_do_for_standard_parameters(make) -> None:  # type: ignore[no-untyped-def]
    mechanism = make()
    base = ec.base_parameters(mechanism)
    found, zeta, qdd = results(mechanism, base.matrix.pivots)
    check_parts(found, zeta, qdd)


def test_an_unknown_name() -> None:
    assert set(NAMES) <= set(FUNCTIONS)
    with pytest.raises(InputError, match=r"there is no function 'dynamics' \(valid: inverse_dynamics, gravity"):
        robot_function("dynamics", arms.rx90(), [0])
    with pytest.raises(InputError, match="pivots are different column numbers from 0 to 59"):
        robot_function("gravity", arms.rx90(), [0, 60])
