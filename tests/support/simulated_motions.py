"""Smooth motions for simulated robots, and the closure of MuJoCo's loops."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from support.simulated_models import Floats

PERIOD, RATE = 10.0, 400.0
"""Length and sampling of motions that are prescribed, s and Hz."""
SIMULATED, LOGGED = 4000.0, 200.0
"""Of those that are simulated: the reference at every half step of the integrator, and the log."""


def fourier(
    rng: np.random.Generator,
    count: int,
    size: float,
    *,
    centre: float = 0.3,
    rate: float = RATE,
    harmonics: int = 8,
) -> tuple[Floats, Floats, Floats]:
    """Random periodic curves with their derivatives."""
    t = np.arange(round(PERIOD * rate)) / rate
    q, qd, qdd = (np.zeros((len(t), count)) for _ in range(3))
    for k in range(1, harmonics + 1):
        w = 2 * np.pi * k / PERIOD
        a, b = size * rng.normal(size=(2, count)) / np.sqrt(harmonics) / k**0.5
        sine, cosine = np.sin(w * t)[:, None], np.cos(w * t)[:, None]
        q += a * sine + b * cosine
        qd += w * (a * cosine - b * sine)
        qdd -= w * w * (a * sine + b * cosine)
    return q + rng.uniform(-centre, centre, count), qd, qdd


def derivative(values: Floats, order: int = 1) -> Floats:
    """Derivative of periodic curves, exact to rounding where they are smooth."""
    w = 2 * np.pi * np.fft.rfftfreq(len(values), 1 / RATE)
    found: Floats = np.fft.irfft(
        (1j * w[:, None]) ** order * np.fft.rfft(values, axis=0), len(values), axis=0
    )
    return found


def floating(joints: int, rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    place, turn, arms = (
        fourier(rng, count, size) for count, size in ((3, 0.5), (3, 0.8), (joints, 0.9))
    )
    quaternions = np.zeros((len(turn[0]), 4))
    for quaternion, vector in zip(quaternions, turn[0], strict=True):
        mujoco.mju_axisAngle2Quat(
            quaternion, vector / np.linalg.norm(vector), np.linalg.norm(vector)
        )
    speed, change = (
        2 * _product(quaternions, derivative(quaternions, order)) for order in (1, 2)
    )
    return (
        np.hstack([place[0], quaternions, arms[0]]),
        np.hstack([place[1], speed, arms[1]]),
        np.hstack([place[2], change, arms[2]]),
    )


def _product(first: Floats, second: Floats) -> Floats:
    """Vector parts of conjugate quaternions times others."""
    w, v, s, u = first[:, :1], first[:, 1:], second[:, :1], second[:, 1:]
    found: Floats = w * u - s * v - np.cross(v, u)
    return found


def closed(
    model: Any, independent: list[int], rng: np.random.Generator
) -> tuple[Floats, Floats, Floats]:
    """All coordinates by Newton's iteration on MuJoCo's own residuals, from those that are chosen."""
    chosen = fourier(rng, len(independent), 0.35, centre=0.1)[0]
    dependent = [k for k in range(model.nq) if k not in independent]
    data = mujoco.MjData(model)
    full = []
    for data.qpos[independent] in chosen:
        J, residual = closure(model, data)
        for _ in range(20):
            data.qpos[dependent] -= np.linalg.lstsq(
                J[:, dependent], residual, rcond=None
            )[0]
            J, residual = closure(model, data)
            if np.abs(residual).max() < 1e-14:
                break
        full.append(data.qpos.copy())
    q = np.array(full)
    return q, derivative(q), derivative(q, 2)


def closure(model: Any, data: Any) -> tuple[Floats, Floats]:
    """Jacobian and residual of the constraints that close loops."""
    mujoco.mj_fwdPosition(model, data)
    rows = np.flatnonzero(
        data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    )
    return data.efc_J.reshape(-1, model.nv)[rows], data.efc_pos[rows].copy()
