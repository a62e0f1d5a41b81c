"""MuJoCo's own equality constraints and energies: an oracle for loops of MJCF that shares nothing with the package."""

from __future__ import annotations

import mujoco
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_OTHERS = (
    mujoco.mjtDisableBit.mjDSBL_CONTACT
    | mujoco.mjtDisableBit.mjDSBL_LIMIT
    | mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
)


class Equalities:
    """The equality constraints of a model.

    Parameters
    ----------
    text : str
    """

    def __init__(self, text: str) -> None:
        self.model = mujoco.MjModel.from_xml_string(text)
        self.model.opt.disableflags |= _OTHERS
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data = mujoco.MjData(self.model)

    def at(self, q: Array) -> tuple[Array, Array]:
        """Values and Jacobian of the constraints, in metres and radians."""
        self.data.qpos[:] = q
        mujoco.mj_fwdPosition(self.model, self.data)
        rows = (
            self.data.efc_type[: self.data.nefc]
            == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        )
        jacobian = self.data.efc_J.reshape(-1, self.model.nv)[: self.data.nefc][rows]
        return self.data.efc_pos[: self.data.nefc][rows].copy(), jacobian.copy()

    def closed(self, q: Array, iterations: int = 100) -> Array:
        """A closed configuration near a guess."""
        q = np.array(q, dtype=float)
        for _ in range(iterations):
            values, jacobian = self.at(q)
            if not len(values) or np.abs(values).max() < 1e-14:
                break
            step = -np.linalg.lstsq(jacobian, values, rcond=1e-9)[0]
            mujoco.mj_integratePos(
                self.model, q, step * min(1.0, 0.3 / np.abs(step).max()), 1.0
            )
        return q

    def walk(
        self, rng: np.random.Generator, strides: int, q: Array, stride: float = 0.1
    ) -> Array:
        """A closed configuration some random strides away, on the same way of assembly."""
        for _ in range(strides):
            free = null_space(self.at(q)[1])
            ahead = np.array(q)
            motion = free @ (free.T @ rng.normal(size=self.model.nv))
            mujoco.mj_integratePos(
                self.model,
                ahead,
                stride * motion / max(np.abs(motion).max(), 1e-12),
                1.0,
            )
            found = self.closed(ahead, 8)
            if np.abs(self.at(found)[0]).max(initial=0.0) < 1e-12:
                q = found
        return q

    def energies(self, q: Array, qd: Array) -> tuple[Array, Array]:
        """Coefficients of the standard parameters in the kinetic and the potential energy, shape (10 · bodies,)."""
        self.data.qpos[:], self.data.qvel[:] = q, qd
        mujoco.mj_fwdPosition(self.model, self.data)
        mujoco.mj_fwdVelocity(self.model, self.data)
        kinetic, potential = [], []
        for body in range(1, self.model.nbody):
            twist = np.zeros(6)
            mujoco.mj_objectVelocity(
                self.model, self.data, mujoco.mjtObj.mjOBJ_XBODY, body, twist, 1
            )
            w, v = twist[:3], twist[3:]
            x, y, z = w
            kinetic += [
                x * x / 2,
                x * y,
                x * z,
                y * y / 2,
                y * z,
                z * z / 2,
                *np.cross(v, w),
                v @ v / 2,
            ]
            rotation, place = self.data.xmat[body].reshape(3, 3), self.data.xpos[body]
            weight = -self.model.opt.gravity
            potential += [0.0] * 6 + [*(rotation.T @ weight), place @ weight]
        return np.array(kinetic), np.array(potential)

    def singular_values(
        self, rng: np.random.Generator, q: Array, states: int, strides: int = 3
    ) -> Array:
        """Those of the energies at closed states, but for a constant; columns are of about equal size."""
        _, rest = self.energies(q, np.zeros(self.model.nv))
        rows = []
        for _ in range(states):
            q = self.walk(rng, strides, q)
            free = null_space(self.at(q)[1])
            kinetic, potential = self.energies(q, free @ rng.normal(size=free.shape[1]))
            rows += [kinetic, potential - rest]
        table = np.array(rows)
        sizes = np.linalg.norm(table, axis=0)
        values: Array = np.linalg.svd(
            table / np.maximum(sizes, 1e-6 * sizes.max()), compute_uv=False
        )
        return values


def null_space(jacobian: Array, tolerance: float = 1e-8) -> Array:
    """Columns that span the motions that a Jacobian allows."""
    if not len(jacobian):
        return np.eye(jacobian.shape[1])
    _, values, rows = np.linalg.svd(jacobian)
    rank = int((values > tolerance * max(values.max(), 1e-300)).sum())
    free: Array = rows[rank:].T
    return free
