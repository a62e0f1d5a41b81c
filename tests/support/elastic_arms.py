"""A two-link arm with elastic drives, simulated by equations of its own: Spong's model with friction in the motors.

M(q) q̈ + c(q, q̇) + g(q) = K (θ/N − q) + D (θ̇/N − q̇);  I θ̈ + Fv θ̇ + Fc sign θ̇ + (K (θ/N − q) + D (θ̇/N − q̇))/N = τ.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp

from echelon.shared import Floats

LENGTH, GRAVITY = 0.4, 9.81


@dataclass(frozen=True)
class ElasticArm:
    """True values: links ZZ1 + l²M2, MX1 + lM2, ZZ2, MX2; then those of each drive, shape (2,)."""

    links: tuple[float, float, float, float] = (1.9, 3.4, 0.35, 0.9)
    rotors: Floats = field(default_factory=lambda: np.array([2e-4, 1e-4]))
    viscous: Floats = field(default_factory=lambda: np.array([4e-3, 2e-3]))
    dry: Floats = field(default_factory=lambda: np.array([0.03, 0.02]))
    stiffness: Floats = field(default_factory=lambda: np.array([4000.0, 1500.0]))
    damping: Floats = field(default_factory=lambda: np.array([6.0, 2.0]))
    ratios: Floats = field(default_factory=lambda: np.array([100.0, 50.0]))
    width: float = 0.5  # of the turn of dry friction, rad/s at the motor

    def link_forces(self, q: Floats, qd: Floats) -> tuple[Floats, Floats]:
        """Mass matrix (2, 2) and the other forces (2,) of the rigid links."""
        zz1, mx1, zz2, mx2 = self.links
        c2, s2 = np.cos(q[1]), np.sin(q[1])
        coupled = LENGTH * mx2 * c2
        mass = np.array(
            [[zz1 + zz2 + 2 * coupled, zz2 + coupled], [zz2 + coupled, zz2]]
        )
        h = LENGTH * mx2 * s2
        outer = GRAVITY * mx2 * np.cos(q[0] + q[1])
        rest = [
            -h * qd[1] * (2 * qd[0] + qd[1]) + GRAVITY * mx1 * np.cos(q[0]) + outer,
            h * qd[0] ** 2 + outer,
        ]
        return mass, np.array(rest)

    def spring(self, q: Floats, qd: Floats, motor: Floats, speed: Floats) -> Floats:
        """Torques of the springs on the links."""
        return self.stiffness * (motor / self.ratios - q) + self.damping * (
            speed / self.ratios - qd
        )

    def friction(self, speed: Floats) -> Floats:
        """Friction of the motors, smooth enough to be integrated."""
        return self.viscous * speed + self.dry * np.tanh(speed / self.width)

    def asked(self, t: float) -> tuple[Floats, Floats]:
        """Motion of the joints that is asked for."""
        size, rate = (
            np.array([[0.7, 0.3], [0.8, 0.35]]),
            np.array([[1.7, 4.3], [2.6, 6.1]]),
        )
        return (size * np.sin(rate * t)).sum(axis=1), (
            size * rate * np.cos(rate * t)
        ).sum(axis=1)

    def drive(self, t: float, motor: Floats, speed: Floats) -> Floats:
        """Torques of the motors, by their controllers."""
        q, qd = self.asked(t)
        return 0.02 * (self.ratios * q - motor) + 0.01 * (self.ratios * qd - speed)

    def simulated(
        self, seconds: float = 12.0, rate: float = 1000.0
    ) -> dict[str, Floats]:
        """A log without noise."""

        def slope(t: float, x: Floats) -> Floats:
            q, motor, qd, speed = x.reshape(4, 2)
            torque = self.spring(q, qd, motor, speed)
            mass, rest = self.link_forces(q, qd)
            rotor = (
                self.drive(t, motor, speed)
                - self.friction(speed)
                - torque / self.ratios
            )
            return np.concatenate(
                [qd, speed, np.linalg.solve(mass, torque - rest), rotor / self.rotors]
            )

        q, qd = self.asked(0.0)
        t = np.arange(0.0, seconds, 1 / rate)
        start = np.concatenate([q, self.ratios * q, qd, self.ratios * qd])
        x = solve_ivp(slope, (0.0, t[-1]), start, "LSODA", t, rtol=1e-9, atol=1e-9).y
        torque = [self.drive(*some) for some in zip(t, x[2:4].T, x[6:].T, strict=True)]
        joint = [
            self.spring(*some)
            for some in zip(x[:2].T, x[4:6].T, x[2:4].T, x[6:].T, strict=True)
        ]
        found = {"t": t} | {f"q{k + 1}": x[k] for k in range(2)}
        found |= {f"theta{k + 1}": x[2 + k] for k in range(2)}
        found |= {f"tau{k + 1}": np.array(torque)[:, k] for k in range(2)}
        return found | {f"joint{k + 1}": np.array(joint)[:, k] for k in range(2)}
