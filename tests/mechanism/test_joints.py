"""Every joint type against two independent models: Lagrange's equations and Pinocchio's own joints.

Lagrange's equations come from a forward kinematics of this file, differentiated by CasADi.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt
import pytest

from echelon.algebra.exact.expressions import parse_angle
from echelon.algebra.exact.polynomial import Polynomial
from echelon.robot.joint import (
    Step,
    ball,
    rotation,
    screw,
    shift,
    translation,
    turn,
)
from echelon.robot.mechanism import Mechanism
from support import textbook_arms as arms
from support.float_regressor import float_regressor, random_states

VALUES = {"a": "0.3", "b": "-0.45", "c": "0.2", "h": "0.05", "g": "9.81"}
OFFSET = np.array([0.3, -0.45, 0.2])
GRAVITY = np.array([1.0, -2.0, -9.0])


def rotation_about(axis: int, angle):  # type: ignore[no-untyped-def]
    """Rodrigues' formula for a coordinate axis."""
    k = np.eye(3)[axis]
    cross = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return (
        ca.DM(np.eye(3))
        + ca.sin(angle) * ca.DM(cross)
        + (1 - ca.cos(angle)) * ca.DM(cross @ cross)
    )


MOUNTING = np.array(rotation_about(2, np.pi / 6) @ rotation_about(0, np.pi / 4))

# Joints with coordinates that are their own derivatives: (our steps, independent pose of the moved frame).
SCALAR_JOINTS: dict[str, tuple[tuple[Step, ...], Callable]] = {
    "revolute x": (
        (rotation("q", 0),),
        lambda q: (rotation_about(0, q[0]), ca.DM.zeros(3)),
    ),
    "revolute -y": (
        (rotation("q", 1, -1),),
        lambda q: (rotation_about(1, -q[0]), ca.DM.zeros(3)),
    ),
    "prismatic -z": (
        (translation("q", 2, -1),),
        lambda q: (ca.DM.eye(3), ca.vertcat(0, 0, -q[0])),
    ),
    "helical y": (
        (screw("q", Polynomial.generator("h"), 1),),
        lambda q: (rotation_about(1, q[0]), ca.vertcat(0, 0.05 * q[0], 0)),
    ),
    "helical -x": (
        (screw("q", Polynomial.generator("h"), 0, -1),),
        lambda q: (rotation_about(0, -q[0]), ca.vertcat(-0.05 * q[0], 0, 0)),
    ),
    "cylindrical": (
        arms.cylindrical_motions("q", 1),
        lambda q: (rotation_about(1, q[1]), ca.vertcat(0, q[0], 0)),
    ),
    "universal": (
        arms.universal_motions("q"),
        lambda q: (rotation_about(0, q[0]) @ rotation_about(1, q[1]), ca.DM.zeros(3)),
    ),
    "planar": (
        arms.planar_motions("q"),
        lambda q: (rotation_about(2, q[2]), ca.vertcat(q[0], q[1], 0)),
    ),
    "planar normal x": (
        arms.planar_motions("q", 0),
        lambda q: (rotation_about(0, q[2]), ca.vertcat(0, q[0], q[1])),
    ),
}


def chain(steps: tuple[Step, ...], kind: str) -> Mechanism:
    """A revolute joint, the joint in question on an odd mounting, and a revolute joint on top."""
    placed = arms.place("a b c", "pi/4 0 pi/6")
    bodies = (
        arms.body(1, 0, "revolute", rotation("first", 0)),
        arms.body(2, 1, kind, placed, *steps),
        arms.body(3, 2, "revolute", placed, rotation("last", 1)),
    )
    return arms.tree(kind, *bodies, gravity="1 -2 -9", values=VALUES)


def energies(poses, velocity, zeta):  # type: ignore[no-untyped-def]
    """Lagrangian of bodies with given (R, p), for standard parameters about their frames."""
    total = 0
    for k, (r, p) in enumerate(poses):
        xx, xy, xz, yy, yz, zz, mx, my, mz, m = zeta[10 * k : 10 * k + 10]
        tensor = ca.DM([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        moment = ca.DM([mx, my, mz])
        spin = r.T @ velocity(r)
        w = ca.vertcat(spin[2, 1], spin[0, 2], spin[1, 0])
        v = r.T @ velocity(p)
        kinetic = (
            0.5 * m * ca.dot(v, v)
            + ca.dot(moment, ca.cross(v, w))
            + 0.5 * ca.dot(w, tensor @ w)
        )
        total += kinetic + ca.dot(ca.DM(GRAVITY), m * p + r @ moment)
    return total


def lagrange(
    pose: Callable,
    n: int,
    zeta: npt.NDArray[np.float64],
    state: tuple[npt.NDArray[np.float64], ...],
) -> npt.NDArray[np.float64]:
    """Generalised forces d/dt ∂L/∂q̇ − ∂L/∂q for the chain with n coordinates in the middle."""
    q, qd, qdd = ca.SX.sym("q", n + 2), ca.SX.sym("qd", n + 2), ca.SX.sym("qdd", n + 2)
    mounting, offset = ca.DM(MOUNTING), ca.DM(OFFSET)
    first = rotation_about(0, q[0])
    r, p = pose(q[1 : n + 1])
    middle = first @ mounting @ r
    at = first @ (offset + mounting @ p)
    last = middle @ mounting @ rotation_about(1, q[n + 1])
    poses = [(first, ca.DM.zeros(3)), (middle, at), (last, at + middle @ offset)]

    def velocity(x):  # type: ignore[no-untyped-def]
        return ca.reshape(ca.jtimes(ca.vec(ca.SX(x)), q, qd), ca.SX(x).shape)

    energy = energies(poses, velocity, zeta)
    momentum = ca.gradient(energy, qd)
    force = (
        ca.jtimes(momentum, q, qd)
        + ca.jtimes(momentum, qd, qdd)
        - ca.gradient(energy, q)
    )
    return np.array(ca.Function("f", [q, qd, qdd], [force])(*state)).ravel()


@pytest.mark.parametrize("kind", SCALAR_JOINTS)
def test_scalar_joint(kind: str) -> None:
    steps, pose = SCALAR_JOINTS[kind]
    mechanism = chain(steps, kind)
    n = len(mechanism.velocities) - 2
    zeta = np.random.default_rng(2).uniform(-1, 1, 30)
    states = random_states(mechanism, 3)
    torque = float_regressor(mechanism, *states) @ zeta
    for k in range(3):
        expected = lagrange(pose, n, zeta, tuple(x[k] for x in states))
        np.testing.assert_allclose(torque[k], expected, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("free", [False, True])
def test_ball(free: bool) -> None:
    """A spherical or floating joint, in quasi-velocities, against universal-plus-revolute Euler angles.

    With R = Rx Ry Rz the angular velocity in body axes is ω = E(φ) φ̇, so Euler's torques are Eᵀ times ours.
    """
    steps = (
        (*(translation(f"t{k}", k) for k in range(3)), ball("s"))
        if free
        else (ball("s"),)
    )
    mechanism = chain(steps, "ball")
    shift = 3 if free else 0

    def pose(q):  # type: ignore[no-untyped-def]
        turned = (
            rotation_about(0, q[shift])
            @ rotation_about(1, q[shift + 1])
            @ rotation_about(2, q[shift + 2])
        )
        return turned, ca.vertcat(*(q[k] for k in range(3))) if free else ca.DM.zeros(3)

    rng = np.random.default_rng(4)
    n = 3 + shift
    zeta = rng.uniform(-1, 1, 30)
    euler = tuple(rng.uniform(-1, 1, n + 2) for _ in range(3))
    phi, phi_d, phi_dd = (x[1 + shift : 4 + shift] for x in euler)
    e, e_dot = euler_map(phi, phi_d)
    ours = (
        np.concatenate([euler[0][: 1 + shift], quaternion(phi), euler[0][-1:]]),
        np.concatenate([euler[1][: 1 + shift], e @ phi_d, euler[1][-1:]]),
        np.concatenate(
            [euler[2][: 1 + shift], e @ phi_dd + e_dot @ phi_d, euler[2][-1:]]
        ),
    )
    torque = float_regressor(mechanism, *ours)[0] @ zeta
    expected = lagrange(pose, n, zeta, euler)
    torque[1 + shift : 4 + shift] = e.T @ torque[1 + shift : 4 + shift]
    np.testing.assert_allclose(torque, expected, rtol=1e-10, atol=1e-10)


def euler_map(phi: npt.NDArray[np.float64], rate: npt.NDArray[np.float64]):  # type: ignore[no-untyped-def]
    """E with ω = E φ̇ in body axes for Rx Ry Rz, and its time derivative."""
    angles = ca.SX.sym("phi", 3)
    ry, rz = rotation_about(1, angles[1]), rotation_about(2, angles[2])
    columns = [
        rz.T @ ry.T @ ca.DM([1, 0, 0]),
        rz.T @ ca.DM([0, 1, 0]),
        ca.DM([0, 0, 1]),
    ]
    e = ca.horzcat(*columns)
    derivative = ca.reshape(ca.jacobian(ca.vec(e), angles) @ ca.DM(rate), 3, 3)
    values = ca.Function("e", [angles], [e, derivative])(phi)
    return np.array(values[0]), np.array(values[1])


def quaternion(phi: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Rx Ry Rz as (w, x, y, z)."""

    def product(a, b):  # type: ignore[no-untyped-def]
        w, v = (
            a[0] * b[0] - a[1:] @ b[1:],
            a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]),
        )
        return np.array([w, *v])

    total = np.array([1.0, 0, 0, 0])
    for axis, angle in enumerate(phi):
        total = product(
            total, np.array([np.cos(angle / 2), *(np.sin(angle / 2) * np.eye(3)[axis])])
        )
    return total


# -- Pinocchio's own joints -------------------------------------------------------------------------------------------

AIM = turn(2, parse_angle("azimuth")) @ turn(1, parse_angle("inclination"))
"""Turns z into a general direction."""
AIMED = np.array(rotation_about(2, 0.7) @ rotation_about(1, 1.1))
VALUES |= {"azimuth": "0.7", "inclination": "1.1"}


def test_a_placement_and_its_inverse() -> None:
    placed = AIM @ shift(1, 2, 3) @ turn(0, parse_angle("inclination"))
    assert (placed @ placed.inverse()).is_identity
    assert (placed.inverse() @ placed).is_identity


def aimed(*steps: Step) -> tuple[Step, ...]:
    """A joint along a general direction of both bodies."""
    return AIM, *steps, AIM.inverse()


def unaligned(name: str, axis: npt.ArrayLike, *more: float) -> Callable[[Any], Any]:
    """Pinocchio's joint with a general axis."""
    return lambda pin: getattr(pin, f"JointModel{name}Unaligned")(
        *np.asarray(axis, dtype=float), *more
    )


def composite(*names: str) -> Callable[[Any], Any]:
    def make(pin: Any) -> Any:
        joint = pin.JointModelComposite()
        for name in names:
            joint.addJoint(getattr(pin, f"JointModel{name}")())
        return joint

    return make


def plain(name: str) -> Callable[[Any], Any]:
    return lambda pin: getattr(pin, f"JointModel{name}")()


Z = AIMED[:, 2]
H = Polynomial.generator("h")
NATIVE: dict[str, tuple[tuple[Step, ...], Callable[[Any], Any]]] = {
    "revolute": (aimed(rotation("q")), unaligned("Revolute", Z)),
    "revolute -x": ((rotation("q", 0, -1),), unaligned("Revolute", (-1, 0, 0))),
    "revolute against": (aimed(rotation("q", 2, -1)), unaligned("Revolute", -Z)),
    "prismatic": (aimed(translation("q")), unaligned("Prismatic", Z)),
    "prismatic -y": ((translation("q", 1, -1),), unaligned("Prismatic", (0, -1, 0))),
    "helical": (aimed(screw("q", H)), unaligned("Helical", Z, 0.05)),
    "helical against": (aimed(screw("q", H, 2, -1)), unaligned("Helical", -Z, 0.05)),
    "cylindrical": (arms.cylindrical_motions("q", 1), composite("PY", "RY")),
    "universal": (
        arms.universal_motions("q"),
        lambda pin: pin.JointModelUniversal(1, 0, 0, 0, 1, 0),
    ),
    "universal z x": (
        arms.universal_motions("q", 2, 0),
        lambda pin: pin.JointModelUniversal(0, 0, 1, 1, 0, 0),
    ),
    "spherical": ((ball("q"),), plain("Spherical")),
    "planar": (arms.planar_motions("q"), plain("Planar")),
    "floating": (arms.floating_motions("q"), plain("FreeFlyer")),
}


@pytest.mark.parametrize("kind", NATIVE)
def test_native_joint(kind: str) -> None:
    import pinocchio as pin

    steps, make = NATIVE[kind]
    mechanism = chain(steps, kind)
    zeta = np.random.default_rng(6).uniform(-1, 1, 30)
    zeta[0::10], zeta[3::10], zeta[5::10], zeta[9::10] = (
        9,
        8,
        10,
        (1.5, 0.7, 2),
    )  # Pinocchio insists on possible bodies
    model = native_chain(pin, make(pin), zeta)
    data = model.createData()
    q, qd, qdd = random_states(mechanism, 3)
    torque = float_regressor(mechanism, q, qd, qdd) @ zeta
    for k in range(3):
        *middle, axes = native_state(pin, kind, q[k, 1:-1], qd[k, 1:-1], qdd[k, 1:-1])
        ends = ((x[k, :1], x[k, -1:]) for x in (q, qd, qdd))
        states = (
            np.concatenate([first, x, last])
            for x, (first, last) in zip(middle, ends, strict=True)
        )
        expected = np.array(pin.rnea(model, data, *states))
        expected[1:-1] = axes @ expected[1:-1]
        np.testing.assert_allclose(
            torque[k], expected, rtol=0, atol=1e-13 * np.abs(expected).max()
        )


def native_chain(pin: Any, joint: Any, zeta: npt.NDArray[np.float64]) -> Any:
    """The chain of :func:`chain` in Pinocchio."""
    model = pin.Model()
    model.gravity.linear = GRAVITY
    mounting, host = pin.SE3(MOUNTING, OFFSET), 0
    for k, (placed, kind) in enumerate(
        [
            (pin.SE3.Identity(), pin.JointModelRX()),
            (mounting, joint),
            (mounting, pin.JointModelRY()),
        ]
    ):
        host = model.addJoint(host, kind, placed, f"joint {k}")
        xx, xy, xz, yy, yz, zz, mx, my, mz, m = zeta[10 * k : 10 * k + 10]
        c = np.array([mx, my, mz]) / m
        central = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - m * (
            c @ c * np.eye(3) - np.outer(c, c)
        )
        model.appendBodyToJoint(host, pin.Inertia(m, c, central), pin.SE3.Identity())
    return model


def native_state(
    pin: Any,
    kind: str,
    q: npt.NDArray[np.float64],
    qd: npt.NDArray[np.float64],
    qdd: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], ...]:
    """Position, velocity and acceleration of a joint in Pinocchio's coordinates, and the axes of its velocities.

    Its linear velocities are in the moved axes, Rᵀ v, with derivative Rᵀ v̇ − ω × Rᵀ v; a quaternion ends with w.
    """
    axes, turning = np.eye(len(qd)), np.zeros((len(qd), len(qd)))
    if kind == "planar":
        axes[:2, :2] = np.array(rotation_about(2, q[2]))[:2, :2]
        turning[:2, :2] = qd[2] * np.array([[0, -1], [1, 0]])
        q = np.array([q[0], q[1], np.cos(q[2]), np.sin(q[2])])
    if kind == "floating":
        axes[:3, :3] = pin.Quaternion(*q[3:]).matrix()
        turning[:3, :3] = pin.skew(qd[3:])
    if kind in ("spherical", "floating"):
        q = np.concatenate([q[:-4], q[-3:], q[-4:-3]])
    v = axes.T @ qd
    return q, v, axes.T @ qdd - turning @ v, axes
