"""The energy form against energies written down by hand, signs included."""

from __future__ import annotations

import numpy as np
import pytest

import arms
from echelon.mechanism.mechanism import Mechanism
from echelon.regressor.energy import energy_form
from echelon.regressor.evaluate import evaluate_floats
from oracles import FloatArray, random_states


def energies(mechanism: Mechanism, q: FloatArray, qd: FloatArray) -> dict[str, FloatArray]:
    """Energy per unit of each parameter."""
    found = evaluate_floats(energy_form(mechanism), mechanism, q, qd, 0 * qd)[:, 0]
    np.testing.assert_array_equal(found[:, 0], 1.0)
    return dict(zip(mechanism.parameters, found[:, 1:].T, strict=True))


def test_a_pendulum_gains_energy_when_it_is_lifted() -> None:
    """Gravity is −g y₀: the potential energy grows with y."""
    mechanism = arms.double_pendulum()
    g, l1 = 9.81, 0.5
    q, qd, _ = random_states(mechanism, 6)
    (a, b), (v, w) = q.T, (qd[:, 0], qd.sum(axis=1))
    found = energies(mechanism, q, qd)
    expected = {
        "ZZ1": v**2 / 2,
        "MX1": g * np.sin(a),
        "MY1": g * np.cos(a),
        "ZZ2": w**2 / 2,
        "MX2": g * np.sin(a + b) + l1 * v * w * np.cos(b),
        "MY2": g * np.cos(a + b) - l1 * v * w * np.sin(b),
        "M2": g * l1 * np.sin(a) + l1**2 * v**2 / 2,
    }
    for name, value in found.items():
        np.testing.assert_allclose(value, expected.get(name, 0 * a), atol=1e-13, err_msg=name)


@pytest.mark.parametrize("gravity", ["0 0 -9.81", "1 -2 -9"])
def test_a_free_body(gravity: str) -> None:
    """½ ωᵀ I ω + m c · (v × ω) + ½ m v² − g · (m p + R m c), with ω in body axes and ṗ in the world's."""
    body = arms.body(1, 0, "floating", *arms.floating_motions("b"))
    mechanism = arms.tree("free", body, gravity=gravity)
    q, qd, _ = random_states(mechanism, 5)
    down = np.array([float(x) for x in gravity.split()])
    found = energies(mechanism, q, qd)
    for k in range(5):
        p, (s, x, y, z) = q[k, :3], q[k, 3:]
        skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turned = np.eye(3) + 2 * s * skew + 2 * skew @ skew
        velocity, spin = turned.T @ qd[k, :3], qd[k, 3:]
        first = np.cross(velocity, spin) - turned.T @ down
        inertia = [*spin**2 / 2, spin[0] * spin[1], spin[0] * spin[2], spin[1] * spin[2]]
        expected = dict(zip(("XX", "YY", "ZZ", "XY", "XZ", "YZ"), inertia, strict=True))
        expected |= dict(zip(("MX", "MY", "MZ"), first, strict=True))
        expected["M"] = velocity @ velocity / 2 - down @ p
        for name, value in expected.items():
            np.testing.assert_allclose(found[f"{name}1"][k], value, atol=1e-12, err_msg=name)


def test_a_slide_along_gravity() -> None:
    """A mass that falls by one metre loses g joules, also where the slide is turned and mounted off the origin."""
    slide = arms.body(1, 0, "prismatic", arms.place("0.2 0 0.7", "pi 0 0"), arms.translation("z"))
    found = energies(arms.tree("slide", slide, gravity="0 0 -10"), np.array([[0.0], [1.0]]), np.zeros((2, 1)))
    assert np.diff(found["M1"])[0] == pytest.approx(-10)
    assert found["M1"][0] == pytest.approx(7)
