"""Functions of robots on arrays of JAX and PyTorch, against automatic differentiation of a Lagrangian of our own."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import echelon as ec
from support.paths import ROOT
from support.selection import slow_unless

jax.config.update("jax_enable_x64", True)

ALPHA = np.pi / 2 * np.array([0, -1, 1, 1, -1, 1, 1])
A = np.array([0, 0, 0, 0.0825, -0.0825, 0, 0.088])
D = np.array([0.333, 0, 0.316, 0, 0.384, 0, 0])
"""Modified Denavit–Hartenberg parameters of a Panda."""


@cache
def arm(joints: int) -> ec.BaseModel:
    """A Panda's first joints."""
    lines = (ROOT / "examples/panda.yaml").read_text().splitlines(keepends=True)
    last = next(k for k, line in enumerate(lines) if line.startswith("modified_dh:"))
    return ec.base_parameters(ec.load("".join(lines[: last + 1 + joints])))


def frames(q: Any) -> list[Any]:
    """Homogeneous transformations of the links."""
    found, frame = [], jnp.eye(4)
    for k in range(len(q)):
        c, s, ca, sa = jnp.cos(q[k]), jnp.sin(q[k]), np.cos(ALPHA[k]), np.sin(ALPHA[k])
        step = [
            [c, -s, 0, A[k]],
            [s * ca, c * ca, -sa, -sa * D[k]],
            [s * sa, c * sa, ca, ca * D[k]],
            [0, 0, 0, 1],
        ]
        frame = frame @ jnp.array(step)
        found.append(frame)
    return found


def pseudo_inertia(z: Any) -> Any:
    """Of ``XX XY XZ YY YZ ZZ MX MY MZ M``: second moments, first moments, mass."""
    half = (z[0] + z[3] + z[5]) / 2
    rows = [
        [half - z[0], -z[1], -z[2], z[6]],
        [-z[1], half - z[3], -z[4], z[7]],
        [-z[2], -z[4], half - z[5], z[8]],
        [z[6], z[7], z[8], z[9]],
    ]
    return jnp.array(rows)


def lagrangian(q: Any, qd: Any, zeta: Any) -> Any:
    places, rates = jax.jvp(frames, (q,), (qd,))
    total = 0.0
    for k in range(len(q)):
        J = pseudo_inertia(zeta[10 * k : 10 * k + 10])
        total += jnp.trace(rates[k] @ J @ rates[k].T) / 2
        total -= 9.81 * (places[k] @ J)[2, 3]
    return total


@jax.jit
def torques(q: Any, qd: Any, qdd: Any, zeta: Any) -> Any:
    def momentum(position: Any, velocity: Any) -> Any:
        return jax.grad(lagrangian, 1)(position, velocity, zeta)

    rate = jax.jvp(momentum, (q, qd), (qd, qdd))[1]
    return rate - jax.grad(lagrangian)(q, qd, zeta)


def state(*shape: int, joints: int = 2) -> list[np.ndarray]:
    return list(np.random.default_rng(0).normal(size=(3, *shape, joints)))


@cache
def slopes_of_torques(joints: int) -> tuple[list[np.ndarray], Any]:
    """Derivatives by position, velocity and acceleration of the Lagrangian's torques, and standard parameters."""
    zeta = np.random.default_rng(1).normal(size=10 * joints)
    slopes = jax.jit(jax.jacfwd(torques, (0, 1, 2)))(*state(joints=joints), zeta)
    return [np.asarray(matrix) for matrix in slopes], zeta


JOINTS = pytest.mark.parametrize("joints", [2, pytest.param(7, marks=pytest.mark.slow)])


@JOINTS
def test_jax_agrees_with_a_lagrangian(joints: int) -> None:
    base, given = arm(joints), state(joints=joints)
    wanted, zeta = slopes_of_torques(joints)
    dynamics, values = base.to_jax(), base.B_float() @ zeta
    found = dynamics.inverse_dynamics(*given, values)
    np.testing.assert_allclose(found, torques(*given, zeta), rtol=1e-11, atol=1e-11)
    every = jax.jacrev(dynamics.inverse_dynamics, (0, 1, 2, 3))
    slopes = every(*given, values)
    for ours, theirs in zip(slopes, wanted, strict=False):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(slopes[3], dynamics.regressor(*given), atol=1e-9)
    np.testing.assert_allclose(
        dynamics.mass_matrix(given[0], values), slopes[2], atol=1e-9
    )


@JOINTS
def test_torch_agrees_with_a_lagrangian(joints: int) -> None:
    torch = pytest.importorskip("torch")
    base, given = arm(joints), tuple(map(torch.tensor, state(joints=joints)))
    wanted, zeta = slopes_of_torques(joints)
    dynamics, values = base.to_torch(), torch.tensor(base.B_float() @ zeta)
    found = dynamics.inverse_dynamics(*given, values)
    truth = torques(*state(joints=joints), zeta)
    np.testing.assert_allclose(found, truth, rtol=1e-11, atol=1e-11)
    slopes = torch.autograd.functional.jacobian(
        dynamics.inverse_dynamics, (*given, values)
    )
    for ours, theirs in zip(slopes, wanted, strict=False):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)
    batch = torch.func.vmap(dynamics.gravity, in_dims=(0, None))
    many = torch.tensor(state(5, joints=joints)[0])
    assert torch.allclose(batch(many, values), dynamics.gravity(many, values))


def torch_arrays() -> tuple[Any, Callable[..., Any], ec.BaseModel]:
    torch = pytest.importorskip("torch")
    return torch, torch.as_tensor, arm(2).to_torch()


def jax_arrays() -> tuple[Any, Callable[..., Any], ec.BaseModel]:
    return jnp, jnp.asarray, arm(2).to_jax()


ROBOTS = slow_unless(
    ("tx40", "furuta"), ["loops/four_bar", "tx40", "floating_tree", "furuta"]
)
LIBRARIES = pytest.mark.parametrize("library", [jax_arrays, torch_arrays])


@LIBRARIES
def test_leading_axes_are_broadcast(library: Callable[[], Any]) -> None:
    _, array, dynamics = library()
    q, qd, qdd = state(4, 1, 3)
    values = np.random.default_rng(2).normal(size=(2, 1, arm(2).rank))
    found = np.asarray(
        dynamics.inverse_dynamics(*map(array, (q, qd, qdd)), array(values))
    )
    assert found.shape == (4, 2, 3, 2)
    for k in range(2):
        flat = [x.reshape(-1, 2) for x in (q, qd, qdd)]
        wanted = arm(2).predict(*flat, values[k, 0])
        np.testing.assert_allclose(found[:, k].reshape(-1, 2), wanted, atol=1e-10)


@LIBRARIES
def test_types_are_kept(library: Callable[[], Any]) -> None:
    module, array, dynamics = library()
    q, values = state()[0], np.ones(arm(2).rank)
    for kind in (module.float32, module.float64, module.bfloat16):
        found = dynamics.mass_matrix(array(q, dtype=kind), array(values, dtype=kind))
        assert found.dtype == kind
    mixed = dynamics.gravity(array(q, dtype=module.float32), array(values))
    assert mixed.dtype == module.float64
    whole = dynamics.regressor(*[array([0, 1])] * 3)
    assert whole.dtype in (module.float32, module.float64)
    np.testing.assert_allclose(whole, arm(2).regressor(*[[0, 1]] * 3), rtol=1e-6)


def test_tensors_stay_on_their_device() -> None:
    """A device without values stands for any other than the processor."""
    torch = pytest.importorskip("torch")
    given = [torch.tensor(x, device="meta") for x in state(3)]
    found = arm(2).to_torch().regressor(*given)
    assert (found.device.type, tuple(found.shape)) == ("meta", (3, 2, arm(2).rank))


@LIBRARIES
@pytest.mark.parametrize("name", ROBOTS)
def test_functions_are_those_of_machine_code(
    library: Callable[[], Any], name: str
) -> None:
    array = library()[1]
    base = ec.base_parameters(ec.load(ROOT / f"examples/{name}.yaml"))
    dynamics = base.to_jax() if library is jax_arrays else base.to_torch()
    rng = np.random.default_rng(3)
    for what in ("regressor", "inverse_dynamics", "gravity", "effects"):
        made = getattr(dynamics, what)
        arguments = [a for a in made.function.arguments if a.name != "symbols"]
        given = {a.name: rng.normal(size=len(a)) for a in arguments}
        kernel = base._evaluator(what).kernel
        wanted = kernel({**given, **made.stated})
        found = made(**{key: array(value) for key, value in given.items()})
        np.testing.assert_allclose(np.asarray(found), wanted[0], rtol=1e-9, atol=1e-9)


@LIBRARIES
def test_geometry_is_an_argument_on_request(library: Callable[[], Any]) -> None:
    array = library()[1]
    base = ec.base_parameters(ec.load(ROOT / "examples/double_pendulum.yaml"))
    make = base.to_jax if library is jax_arrays else base.to_torch
    q = np.array([0.3, -0.7])
    assert make().regressor.function.arguments[-1].labels == ("l1", "g")
    symbols = {"g": 3.0, "l1": 0.5}
    wanted = base.regressor(q, q, q, symbols)
    stated = make(symbols).regressor(*[array(q)] * 3)
    passed = make().regressor(*[array(q)] * 3, symbols=array([0.5, 3.0]))
    np.testing.assert_allclose(stated, wanted)
    np.testing.assert_allclose(passed, wanted)


def test_wrong_calls_are_refused() -> None:
    dynamics = arm(2).to_jax()
    with pytest.raises(ec.InputError, match=r"q has shape \(6,\); expected \(..., 2\)"):
        dynamics.gravity(jnp.zeros(6), jnp.zeros(arm(2).rank))
    with pytest.raises(
        ec.InputError, match=r"parameters is missing.*gravity\(q, param"
    ):
        dynamics.gravity(jnp.zeros(2))
    with pytest.raises(ec.InputError, match="others than"):
        dynamics.gravity(jnp.zeros(2), jnp.zeros(arm(2).rank), speed=1)
    with pytest.raises(AttributeError, match="no function 'torque'"):
        _ = dynamics.torque
    with pytest.raises(ec.InputError, match="has none"):
        _ = dynamics.closed_positions
    assert copy.copy(dynamics).gravity is dynamics.gravity
    unstated = ec.base_parameters(ec.load(ROOT / "examples/stanford.yaml"))
    with pytest.raises(ec.InputError, match="d2"):
        _ = unstated.to_jax().regressor
