"""The energy form against energies worked out by hand, term by term."""

from __future__ import annotations

import numpy as np
import pytest

from echelon.mechanism.joint import rotation, translation
from echelon.mechanism.mechanism import Mechanism
from echelon.regressor.evaluate import evaluate_floats
from echelon.regressor.linear import energy_form
from support import textbook_arms as arms

G = np.array([1.5, -2.0, -9.81])


def energies(mechanism: Mechanism, q: list[float], qd: list[float]) -> dict[str, float]:
    """Coefficient of every standard parameter at one state, and of the constant."""
    state = (np.array([x]) for x in (q, qd, np.zeros_like(qd)))
    (row,) = evaluate_floats(energy_form(mechanism), mechanism, *state)[0]
    return dict(zip(("1", *mechanism.parameters), row, strict=True))


def slider() -> Mechanism:
    """A body that slides along the base's y axis from the point (0.3, 0.5, −0.2), with its axes turned about z."""
    steps = (arms.place("3/10 1/2 -1/5"), translation("y", 1), arms.place("0 0 0", "0 0 pi/2"))
    return arms.tree("slider", arms.body(1, 0, "prismatic", *steps), gravity="3/2 -2 -9.81")


@pytest.mark.parametrize("y", [0.0, 0.7, -1.9])
def test_potential_energy_of_a_mass_is_minus_gravity_times_its_place(y: float) -> None:
    found = energies(slider(), [y], [0.0])
    assert found["1"] == 1
    assert found["M1"] == pytest.approx(-G @ [0.3, 0.5 + y, -0.2])
    # the body's x axis is the base's y axis
    assert [found[f"M{c}1"] for c in "XYZ"] == pytest.approx([-G[1], G[0], -G[2]])


def test_kinetic_energy_of_a_mass_is_half_its_speed_squared() -> None:
    still, moving = energies(slider(), [0.4], [0.0]), energies(slider(), [0.4], [3.0])
    gained = {name: moving[name] - still[name] for name in moving}
    assert gained == pytest.approx({**dict.fromkeys(gained, 0.0), "M1": 4.5})


def test_pendulum_rises_by_the_height_of_its_mass() -> None:
    """A mass at distance l on a pendulum about y has height −l cos q; carried by the body's own M or by MX."""
    place = arms.place("0 0 -1/2")
    first = arms.body(1, 0, "revolute", rotation("q", 1))
    second = arms.body(2, 1, "fixed", place)
    angle, rate, length = 0.6, 1.7, 0.5
    found = energies(arms.tree("pendulum", first, second, gravity="0 0 -9.81"), [angle], [rate])
    height = -length * np.cos(angle)
    assert found["M2"] == pytest.approx(9.81 * height + (length * rate) ** 2 / 2)
    assert found["MZ1"] == pytest.approx(9.81 * np.cos(angle))
    assert found["MX1"] == pytest.approx(-9.81 * np.sin(angle))
    assert found["YY1"] == pytest.approx(rate**2 / 2)
    assert found["M1"] == found["XX1"] == found["XY1"] == 0
