"""Arms with a known payload."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import echelon as ec
from echelon.identification.current_fit import gain_names
from echelon.identification.logs.recording import Samples
from echelon.identification.payload import Payload, loaded_rows, with_zeros
from echelon.identification.rows.rows import ModelRows
from echelon.robot.effect import Side, ready_made

LOAD = (0.021, 0.004, -0.01, 0.032, 0.006, 0.025, 0.15, -0.06, 0.34, 4.9)


def with_drives(arm: ec.Mechanism) -> ec.Mechanism:
    names = arm.velocities
    effects = [
        effect
        for kind in ("viscous", "coulomb", "drive_gain")
        for k, name in enumerate(names, start=1)
        for effect in ready_made(kind, name, Side.ACTUATOR, str(k), sliding=False)
    ]
    return replace(arm, effects=tuple(effects))


@dataclass
class Truth:
    """A robot, its base parameters with gains, and its payload."""

    base: ec.BaseModel
    values: np.ndarray
    load: ec.BaseModel
    load_values: np.ndarray
    gains: np.ndarray

    def run(
        self, seed: int, noise: float, *, loaded: bool, count: int = 1200
    ) -> Samples:
        """Currents of a motion of sines, with noise as a share of each current's rms."""
        rng = np.random.default_rng(seed)
        m = len(self.gains)
        t = np.arange(count) / 200
        rates, phases, sizes = (
            rng.uniform(1, 7, (3, m, 1)),
            rng.uniform(0, 6, (3, m, 1)),
            rng.uniform(0.3, 0.9, (3, m, 1)),
        )
        arguments = rates * t + phases
        q = (sizes * np.sin(arguments)).sum(axis=0).T + rng.uniform(-1, 1, m)
        qd = (sizes * rates * np.cos(arguments)).sum(axis=0).T
        qdd = -(sizes * rates**2 * np.sin(arguments)).sum(axis=0).T
        names = self.base.mechanism.velocities
        without = np.where(
            np.isin(self.base.pivots, gain_names(self.base)), 0.0, self.values
        )
        torque = self.base.predict(
            q, qd, qdd, without, inputs={name: np.zeros(count) for name in names}
        )
        if loaded:
            torque = torque + self.load.predict(q, qd, qdd, self.load_values)
        current = torque / self.gains
        current = current + noise * np.sqrt(np.mean(current**2, axis=0)) * rng.normal(
            size=current.shape
        )
        return Samples(
            "run",
            0.0,
            200.0,
            q,
            qd,
            qdd,
            None,
            dict(zip(names, current.T, strict=True)),
        )

    def observations(
        self, seed: int, noise: float, payload: Payload, count: int = 1200
    ) -> tuple[ec.Observation, ec.Observation]:
        free = with_zeros(
            self.base, self.run(2 * seed, noise, loaded=False, count=count)
        )
        carrying = self.run(2 * seed + 1, noise, loaded=True, count=count)
        return ModelRows.of(self.base, [free]).observation(), loaded_rows(
            self.base, payload, [carrying]
        ).observation()


def truth(arm: ec.Mechanism, body: str, seed: int = 0) -> Truth:
    base = ec.base_parameters(with_drives(arm))
    rng = np.random.default_rng(seed)
    load = Payload.of(body, LOAD).base(base)
    gains = rng.uniform(5, 60, len(arm.velocities)) * np.where(
        np.arange(len(arm.velocities)) == 1, -1, 1
    )
    standard = []
    for parameter in base.mechanism.columns:
        if parameter.body is None:
            standard.append(rng.uniform(0.5, 2.0))
        else:
            standard.append(
                {0: 3.0, 1: 1.0, 2: 0.15}[parameter.length_degree]
                * rng.uniform(0.5, 1.5)
            )
    values = base.values(standard)
    for name, gain in zip(gain_names(base), gains, strict=True):
        values[base.pivots.index(name)] = gain
    return Truth(base, values, load, load.values(LOAD), gains)
