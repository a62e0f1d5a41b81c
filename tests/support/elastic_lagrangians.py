"""Random arms with elastic drives, by Lagrange's equations of CasADi: no recursion, no rule for springs or rotors."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from echelon.shared import Floats

GRAVITY = (1.2, -3.4, -9.1)
LIMITS = {"alpha": 1.4, "a": 0.6, "theta": 1.4, "d": 0.5}
PARTS = ("Fv", "Ks", "Ds", "Ps")


@dataclass(frozen=True)
class ElasticChain:
    """A chain by modified Denavit–Hartenberg parameters with an elastic drive in every joint."""

    rows: tuple[dict[str, Any], ...]
    rotors: tuple[dict[str, Any], ...]
    sensors: tuple[bool, ...]  # joints with torque sensors

    @staticmethod
    def random(seed: int) -> ElasticChain:
        rng = np.random.default_rng(seed)
        count = int(rng.integers(1, 4))
        rows, rotors = [], []
        for k in range(1, count + 1):
            sizes = {n: round(float(rng.uniform(-x, x)), 3) for n, x in LIMITS.items()}
            kind = "prismatic" if rng.random() < 0.25 else "revolute"
            rows.append({"joint": kind, **sizes})
            turn = [round(float(x), 2) for x in rng.uniform(-1, 1, 3)]
            on = "base" if rng.random() < 0.3 else f"j{int(rng.integers(1, k + 1))}"
            ratio = int(rng.integers(2, 120)) * int(rng.choice([-1, 1]))
            rotor = {"name": f"m{k}", "on": on, "drives": f"{ratio}*j{k}"}
            rotors.append({**rotor, "elastic": True, "frame": {"rpy": turn}})
        return ElasticChain(
            tuple(rows), tuple(rotors), tuple((rng.random(count) < 0.3).tolist())
        )

    @property
    def description(self) -> str:
        """Its description, with friction in the motors."""
        count = len(self.rows)
        outputs = [{"actuator": f"m{k + 1}"} for k in range(count)]
        outputs += [
            {"joint": f"j{k + 1}", "name": f"torque{k + 1}"}
            for k in range(count)
            if self.sensors[k]
        ]
        return json.dumps(
            {
                "echelon": 1,
                "gravity": list(map(str, GRAVITY)),
                "modified_dh": self.rows,
                "rotors": self.rotors,
                "effects": [{"type": "viscous", "at": "all"}],
                "outputs": outputs,
            }
        )

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters, in the order of the regressor below."""
        kinds = ["XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M"]
        count = range(1, len(self.rows) + 1)
        links = [f"{kind}{k}" for k in count for kind in kinds]
        return [
            *links,
            *(f"ZZ_m{k}" for k in count),
            *(f"{n}{k}" for n in PARTS for k in count),
        ]

    def regressor(self, q: Floats, qd: Floats, qdd: Floats) -> tuple[list[str], Floats]:
        """Names of outputs, and derivatives of the outputs by the parameters at states (joints, then rotors)."""
        names, function = self._recorded()
        rows = [np.array(function(*some)) for some in zip(q, qd, qdd, strict=True)]
        return names, np.array(rows)

    def _recorded(self) -> tuple[list[str], ca.Function]:
        count = len(self.rows)
        x, v, a = (ca.SX.sym(name, 2 * count) for name in "xva")
        zeta = ca.SX.sym("zeta", len(self.parameters))
        values = dict(zip(self.parameters, ca.vertsplit(zeta), strict=True))
        energy, turns = self._links(x, v, values)
        share = [1 / int(r["drives"].split("*")[0]) for r in self.rotors]
        dissipated: list[Any] = [0] * 2 * count
        springs: list[Any] = [0] * count
        for k, rotor in enumerate(self.rotors):
            carrier = turns[0 if rotor["on"] == "base" else int(rotor["on"][1:])]
            axis = carrier @ _rpy(rotor["frame"]["rpy"])[:, 2]
            along = ca.dot(_rate(carrier, x, v), axis) + v[count + k]
            energy += values[f"ZZ_m{k + 1}"] * along**2 / 2
            stretch, speed = (s[k] - share[k] * s[count + k] for s in (x, v))
            springs[k] = (
                values[f"Ks{k + 1}"] * stretch
                + values[f"Ds{k + 1}"] * speed
                + values[f"Ps{k + 1}"]
            )
            dissipated[k] = springs[k]
            dissipated[count + k] = (
                values[f"Fv{k + 1}"] * v[count + k] - share[k] * springs[k]
            )
        slope = ca.gradient(energy, v)
        force = ca.jtimes(slope, v, a) + ca.jtimes(slope, x, v) - ca.gradient(energy, x)
        force += ca.vertcat(*dissipated)
        outputs = {
            f"m{k + 1}": force[count + k] + share[k] * force[k] for k in range(count)
        }
        for k in range(count):
            outputs[f"m{k + 1}.spring"] = force[count + k]
            if self.sensors[k]:
                outputs[f"torque{k + 1}"] = force[k] - springs[k]
                outputs[f"m{k + 1}.spring"] = -springs[k]
        table = ca.jacobian(ca.vertcat(*outputs.values()), zeta)
        return list(outputs), ca.Function("regressor", [x, v, a], [table])

    def _links(self, x: Any, v: Any, values: dict[str, Any]) -> tuple[Any, list[Any]]:
        """Kinetic less potential energy of the links, and the rotations of the frames, the base's first."""
        turn, place, energy = ca.SX.eye(3), ca.SX.zeros(3), 0
        turns = [turn]
        for k, row in enumerate(self.rows):
            theta, d = row["theta"], row["d"]
            if row["joint"] == "revolute":
                theta = theta + x[k]
            else:
                d = d + x[k]
            turn = turn @ _about(0, row["alpha"])
            place = place + turns[-1] @ ca.vertcat(row["a"], 0, 0) + d * turn[:, 2]
            turn = turn @ _about(2, theta)
            turns.append(turn)
            part = {
                n: values[f"{n}{k + 1}"]
                for n in ["XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M"]
            }
            moment = turn @ ca.vertcat(part["MX"], part["MY"], part["MZ"])
            tensor = ca.vertcat(
                ca.horzcat(part["XX"], part["XY"], part["XZ"]),
                ca.horzcat(part["XY"], part["YY"], part["YZ"]),
                ca.horzcat(part["XZ"], part["YZ"], part["ZZ"]),
            )
            rate, speed = _rate(turn, x, v), ca.jtimes(place, x, v)
            own = turn.T @ rate
            energy += part["M"] * ca.dot(speed, speed) / 2
            energy += ca.dot(speed, ca.cross(rate, moment)) + own.T @ tensor @ own / 2
            energy += ca.dot(ca.vertcat(*GRAVITY), part["M"] * place + moment)
        return energy, turns


def _about(axis: int, angle: Any) -> Any:
    c, s = ca.cos(angle), ca.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    found = ca.SX.eye(3)
    found[i, i], found[i, j], found[j, i], found[j, j] = c, -s, s, c
    return found


def _rpy(angles: list[float]) -> Any:
    roll, pitch, yaw = angles
    return _about(2, yaw) @ _about(1, pitch) @ _about(0, roll)


def _rate(turn: Any, x: Any, v: Any) -> Any:
    """Angular velocity of a frame, from the derivative of its rotation."""
    change = ca.reshape(ca.jtimes(ca.reshape(turn, 9, 1), x, v), 3, 3) @ turn.T
    return ca.vertcat(change[2, 1], change[0, 2], change[1, 0])
