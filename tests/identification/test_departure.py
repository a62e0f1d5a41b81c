"""Bodies that are far from their prior: named, with the choices, and at the head of written files."""

from __future__ import annotations

import numpy as np

import echelon as ec
from echelon.formats.robot_file import open_robot
from echelon.formats.writers.robot_writer import identified_robot
from echelon.identification.physics.fit import departures
from support.paths import EXAMPLES


def test_a_heavy_link_is_named_here_and_in_the_file() -> None:
    file = open_robot(EXAMPLES / "two_link.xml")
    mechanism = file.mechanism()
    stated = np.array([value or 0.0 for value in mechanism.standard_values()])
    assert departures(mechanism, 4.9 * stated, stated, 1.0) == []
    heavy = stated.copy()
    heavy[10:20] *= 80
    (found,) = departures(mechanism, heavy, stated, 1.0)
    name = mechanism.bodies[1].name
    assert f"'{name}' {heavy[19]:.3g} kg for {stated[19]:.3g} kg" in found.text
    assert "total_mass" in found.text
    (written,) = identified_robot(mechanism, heavy, file, [found.text])
    assert f"'{name}' {heavy[19]:.3g} kg for" in written.text
    assert found.text in written.notes


def test_unknown_priors_are_no_departure() -> None:
    mechanism = ec.load(EXAMPLES / "two_link.xml")
    values = np.array([value or 0.0 for value in mechanism.standard_values()])
    assert departures(mechanism, values, np.full(len(values), np.nan), 0.0) == []


def test_masses_that_are_rounding_are_not_written() -> None:
    file = open_robot(EXAMPLES / "two_link.xml")
    mechanism = file.mechanism()
    values = np.array([value or 0.0 for value in mechanism.standard_values()])
    values[10:20] = 2.76e-35 * np.array([1, 0, 0, 1, 0, 1, 0, 0, 0, 1])
    (written,) = identified_robot(mechanism, values, file)
    assert "e-35" not in written.text
