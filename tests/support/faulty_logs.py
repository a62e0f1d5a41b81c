"""A clean log of two joints, changes of it, and the one finding that a change should give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from echelon.formats.robot_file import load
from echelon.identification.logs.finding import Finding
from echelon.identification.logs.recording import Recording

Floats = npt.NDArray[np.float64]

ARM = load("examples/double_pendulum.yaml")

RATE = 250.0
COUNT = 5000


def clean(seed: int = 0, noise: float = 1e-4, count: int = COUNT) -> Recording:
    """A smooth motion of two joints with its exact derivatives, outputs that depend on it, and some noise."""
    random = np.random.default_rng(seed)
    time = np.arange(count) / RATE
    q, qd, qdd = (np.zeros((count, 2)) for _ in range(3))
    for column in range(2):
        for _ in range(4):
            size, omega, phase = (
                random.uniform(0.2, 0.6),
                random.uniform(1, 9),
                random.uniform(0, 6),
            )
            q[:, column] += size * np.sin(omega * time + phase)
            qd[:, column] += size * omega * np.cos(omega * time + phase)
            qdd[:, column] -= size * omega**2 * np.sin(omega * time + phase)
    y = 2 * qdd + 0.5 * np.tanh(50 * qd) + 9 * np.sin(q)
    shaken = {
        name: v + noise * random.normal(size=v.shape)
        for name, v in {"q": q, "qd": qd, "qdd": qdd, "y": y}.items()
    }
    return Recording("run", time, shaken)


def changed(recording: Recording, signal: str, values: Floats) -> Recording:
    return replace(recording, signals={**recording.signals, signal: values})


def one(findings: tuple[Finding, ...], kind: str) -> Finding:
    found = [finding for finding in findings if finding.kind == kind]
    assert len(found) == 1, [str(finding) for finding in findings]
    others = [
        finding for finding in findings if finding.kind not in (kind, "smooth")
    ]  # as made-up positions are
    assert not others, [str(finding) for finding in findings]
    return found[0]
