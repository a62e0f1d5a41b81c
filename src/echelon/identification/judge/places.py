"""Places of effects: drives and joints whose force is a measured output."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from echelon.identification.logs.columns.column_map import signal_names
from echelon.robot import Mechanism, Side, known_values
from echelon.shared import Floats

Motion = tuple[Floats, Floats, Floats]
"""Positions, velocities and accelerations, each of shape (samples, …)."""


@dataclass(frozen=True)
class Place:
    """An output that is the force of one drive or joint, and the coordinate of that."""

    output: int
    name: str
    ratios: tuple[
        tuple[int, int, float], ...
    ]  # columns of positions and of velocities, and ratio, of coordinates

    def state(self, motion: Motion) -> Motion:
        """Position, velocity and acceleration of the coordinate, each of shape (samples,)."""
        positions, *rates = motion
        q = np.sum([r * positions[:, p] for p, _, r in self.ratios], axis=0)
        qd, qdd = (
            np.sum([r * x[:, v] for _, v, r in self.ratios], axis=0) for x in rates
        )
        return q, qd, qdd


def places(mechanism: Mechanism, q: int, qd: int) -> Iterator[Place]:
    """Outputs that are forces of one drive or joint, for states with numbers of positions and velocities."""
    positions = signal_names(mechanism, "q", q)
    velocities = signal_names(mechanism, "qd", qd)
    known = known_values(mechanism)
    drives = {a.name: a.terms for a in mechanism.transmission.actuators}
    for k, output in enumerate(mechanism.outputs):
        if len(output.forces) != 1 or output.cuts:
            continue
        force, _ = output.forces[0]
        ratios = {force.at: 1.0}
        if force.side is Side.ACTUATOR:
            ratios = {
                n: r.at(known)
                for n, r in drives[force.at]
                if known.keys() >= set(r.symbols())
            }
        if ratios and all(n in positions and n in velocities for n in ratios):
            yield Place(
                k,
                force.at,
                tuple(
                    (positions.index(n), velocities.index(n), r)
                    for n, r in ratios.items()
                ),
            )
