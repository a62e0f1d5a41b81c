"""Functions of mechanisms with loops in independent coordinates, against Pinocchio, MuJoCo, differences and energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import echelon as ec
from echelon.algebra.program.function import Function
from echelon.dynamics.arguments import geometry_values
from echelon.dynamics.functions import LOOP_FUNCTIONS, robot_function
from echelon.loops.assembly import Assembly
from echelon.loops.closed_motion import normalised, position_rates
from echelon.robot.closure import ClosureKind
from echelon.robot.effect import Action, Effect, Side
from echelon.robot.mechanism import Mechanism
from echelon.shared.errors import InputError
from support import linkages
from support.closed_motion import accelerations
from support.derived import base_of
from support.float_regressor import FloatArray
from support.generated_code import reference
from support.loop_states import closed_states, independent_columns
from support.paths import ROOT
from support.pinocchio_loops import Constrained
from support.selection import one_in, slow_unless
from support.written_robots import random_parameters

LOOPS = ROOT / "examples" / "loops"
EXAMPLES = (
    "bennett",
    "delta",
    "four_bar",
    "gough_stewart",
    "parallelogram",
    "sr400",
    "three_rps",
)
# every kind of closure, by turns in plain chains, in branched ones and in ones with couplings
CHAINS = [
    linkages.closed_chain(k, n % 3 == 1, n % 3 == 2) for n, k in enumerate(ClosureKind)
]
ALL = [
    pytest.param(m, id=m.name)
    for m in (*CHAINS, linkages.slider_crank(), linkages.rssr())
]
ALL += [
    pytest.param(name, id=name, marks=[pytest.mark.slow] * (name == "gough_stewart"))
    for name in EXAMPLES
]


@cache
def example(name: str) -> Mechanism:
    return ec.load(LOOPS / (name if "." in name else f"{name}.yaml"))


def made(mechanism: Mechanism | str) -> Mechanism:
    return example(mechanism) if isinstance(mechanism, str) else mechanism


class Functions:
    """The functions of a mechanism in NumPy, of all standard parameters."""

    def __init__(self, mechanism: Mechanism, zeta: FloatArray) -> None:
        self.mechanism, self._known = (
            mechanism,
            {"parameters": zeta, "standard_parameters": zeta},
        )
        self._functions: dict[str, Function] = {}

    def recorded(self, name: str) -> Function:
        if name not in self._functions:
            self._functions[name] = robot_function(
                name, self.mechanism, range(len(self.mechanism.parameters))
            )
        return self._functions[name]

    def __call__(self, name: str, **state: FloatArray) -> FloatArray:
        function = self.recorded(name)
        return reference(
            function,
            {
                **state,
                **self._known,
                **geometry_values(self.mechanism, function.arguments),
            },
        )


def regular_states(functions: Functions, count: int) -> tuple[FloatArray, ...]:
    """Random closed states; of twenty, those farthest from singular ones."""
    states = closed_states(functions.mechanism, 20)
    pivots = functions("closure_pivots", q=states[0]).min(axis=1)
    best = np.argsort(pivots)[-count:]
    return tuple(part[best] for part in states)


def tree_terms(
    mechanism: Mechanism, zeta: FloatArray, q: FloatArray, qd: FloatArray
) -> tuple[FloatArray, ...]:
    """M, h, and gravity of the tree, and all velocities by the independent ones, by Pinocchio."""
    model = Constrained(mechanism, zeta)
    positions, moved = model.joint_positions(q), model.couplings
    mass = pin.crba(model.model, model.data, positions)
    mass = np.triu(mass) + np.triu(mass, 1).T
    jacobian, free = model.closing(q), independent_columns(mechanism)
    bound = [k for k in range(len(mechanism.velocities)) if k not in free]
    G = np.zeros((len(mechanism.velocities), len(free)))
    G[free] = np.eye(len(free))
    G[bound] = -np.linalg.lstsq(jacobian[:, bound], jacobian[:, free], rcond=1e-9)[0]
    h = moved.T @ pin.nonLinearEffects(model.model, model.data, positions, moved @ qd)
    weight = moved.T @ pin.computeGeneralizedGravity(model.model, model.data, positions)
    return moved.T @ mass @ moved, h, weight, G


def close(found: FloatArray, expected: FloatArray, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=tolerance * max(np.abs(expected).max(), 1e-3)
    )


@pytest.mark.parametrize("mechanism", one_in(6, ALL))
def test_equations_of_motion_are_those_of_the_tree_in_independent_coordinates(
    mechanism: Mechanism | str,
) -> None:
    mechanism = made(mechanism)
    zeta, (q, qd, qdd) = random_parameters(mechanism), closed_states(mechanism, 4)
    free, functions = independent_columns(mechanism), Functions(mechanism, zeta)
    state = {"q": q, "qd": qd[:, free], "qdd": qdd[:, free]}
    close(functions("closed_velocities", **state), qd, 1e-8)
    close(functions("closed_accelerations", **state), qdd, 1e-7)
    without = accelerations(
        Assembly(mechanism), q, qd, np.zeros((len(q), len(free)))
    )  # Ġ q̇
    terms = [tree_terms(mechanism, zeta, *one) for one in zip(q, qd, strict=True)]
    mass = functions("mass_matrix", **state)
    close(mass, np.array([G.T @ M @ G for M, _, _, G in terms]), 1e-8)
    close(mass, mass.swapaxes(1, 2))
    weight = functions("gravity", **state)
    close(weight, np.array([G.T @ g for _, _, g, G in terms]), 1e-8)
    h = np.array(
        [G.T @ (h + M @ a) for (M, h, _, G), a in zip(terms, without, strict=True)]
    )
    close(functions("coriolis", **state) + weight, h, 1e-7)
    effort = functions("inverse_dynamics", **state)
    close(effort, np.einsum("nij,nj->ni", mass, state["qdd"]) + h, 1e-7)
    close(functions("regressor", **state) @ zeta, effort, 1e-9)


@pytest.mark.parametrize("mechanism", one_in(3, ALL[2::4][::-1]))
def test_derivatives_are_those_along_closed_motions(mechanism: Mechanism | str) -> None:
    mechanism = made(mechanism)
    free, names = independent_columns(mechanism), mechanism.independent_velocities
    friction = Effect(
        "Fv", "N·m·s/rad", (Action(mechanism.velocities[-1], Side.JOINT, "qd"),)
    )
    if (
        mechanism.velocities[-1][-1] not in "xyz"
    ):  # a free rotation has no coordinate that a term could use
        mechanism = replace(mechanism, effects=(friction,))
    functions = Functions(mechanism, random_parameters(mechanism))
    q, qd, qdd = regular_states(functions, 3)
    state = {"q": q, "qd": qd[:, free], "qdd": qdd[:, free]}
    h, found = 1e-4, functions("inverse_dynamics_derivatives", **state)
    assert found.shape == (3, len(mechanism.outputs), 2 * len(names))

    def moved(column: int, size: float) -> dict[str, FloatArray]:
        step = np.zeros((len(q), len(names)))
        step[:, column % len(names)] = size
        if column >= len(names):
            return {**state, "qd": state["qd"] + step}
        rates = functions("closed_velocities", q=q, qd=step)
        there = normalised(mechanism, q + position_rates(mechanism, q, rates))
        for _ in range(4):
            there = functions("closed_positions", q=there)
        return {**state, "q": there}

    for column in range(2 * len(names)):
        ends = [
            functions("inverse_dynamics", **moved(column, k * h))
            for k in (1, -1, 2, -2)
        ]
        expected = (8 * (ends[0] - ends[1]) - (ends[2] - ends[3])) / (12 * h)
        np.testing.assert_allclose(
            found[:, :, column], expected, rtol=0, atol=1e-6 * np.abs(found).max()
        )


@pytest.mark.parametrize(
    "name",
    slow_unless(
        ["four_bar", "slider-crank"], ["four_bar", "three_rps", "slider-crank"]
    ),
)
def test_simulated_motion_keeps_its_energy_but_for_the_work_of_the_drives(
    name: str,
) -> None:
    mechanism = linkages.slider_crank() if name == "slider-crank" else example(name)
    zeta = np.tile(
        [0.02, 0, 0, 0.02, 0, 0.02, 0.1, 0.05, 0.0, 1.0], len(mechanism.bodies)
    )
    functions, model, free = (
        Functions(mechanism, zeta),
        Constrained(mechanism, zeta),
        independent_columns(mechanism),
    )
    q, qd = Assembly(mechanism).pose[None], np.full((1, len(free)), 0.4)
    force, h = np.linspace(0.5, 1.0, len(free)), 2e-3

    def rates(q: FloatArray, qd: FloatArray) -> tuple[FloatArray, FloatArray]:
        held = functions("coriolis", q=q, qd=qd) + functions("gravity", q=q)
        qdd = np.linalg.solve(
            functions("mass_matrix", q=q), (force - held)[:, :, None]
        )[:, :, 0]
        return position_rates(
            mechanism, q, functions("closed_velocities", q=q, qd=qd)
        ), qdd

    def energy() -> float:
        return model.energy(q[0], functions("closed_velocities", q=q, qd=qd)[0])

    start, work = energy(), 0.0
    for _ in range(25):
        a, b = rates(q, qd), None
        b = rates(q + h / 2 * a[0], qd + h / 2 * a[1])
        c = rates(q + h / 2 * b[0], qd + h / 2 * b[1])
        d = rates(q + h * c[0], qd + h * c[1])
        work += float(force @ (qd[0] * h + h * h / 6 * (a[1] + b[1] + c[1])[0]))
        q = normalised(mechanism, q + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0]))
        qd = qd + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
        q = functions("closed_positions", q=q)
    assert abs(work) > 1e-3
    np.testing.assert_allclose(energy() - start, work, atol=1e-8)


@pytest.mark.parametrize("mechanism", one_in(4, ALL))
def test_forces_of_closures_are_lagrange_multipliers(
    mechanism: Mechanism | str,
) -> None:
    mechanism = made(mechanism)
    zeta, (q, qd, qdd) = random_parameters(mechanism), closed_states(mechanism, 3)
    free, functions, model = (
        independent_columns(mechanism),
        Functions(mechanism, zeta),
        Constrained(mechanism, zeta),
    )
    state = {"q": q, "qd": qd[:, free], "qdd": qdd[:, free]}
    if mechanism.name == "bennett":
        with pytest.raises(
            InputError,
            match="redundant constraints leave all forces of the closures undetermined",
        ):
            functions("constraint_forces", **state)
        return
    found = functions("constraint_forces", **state)
    columns = {
        name: k
        for k, name in enumerate(functions.recorded("constraint_forces").axes[0])
    }
    for sample, one in enumerate(zip(q, qd, qdd, strict=True)):
        _, multipliers = model.dynamics(*one)
        for closure in mechanism.closures:
            _, basis = model.basis(closure)
            force, multipliers = (
                multipliers[: len(basis)] @ basis,
                multipliers[len(basis) :],
            )
            for k, axis in enumerate("xyz"):
                column = columns.get(f"{closure.name}: force {axis}")
                if column is not None:
                    assert found[sample, column] == pytest.approx(
                        force[k], abs=1e-7 * np.abs(found).max()
                    )
                column = columns.get(f"{closure.name}: moment {axis}")
                if (
                    column is not None and len(closure.kind.positions) == 3
                ):  # elsewhere frames have other origins
                    assert found[sample, column] == pytest.approx(
                        force[3 + k], abs=1e-7 * np.abs(found).max()
                    )


def test_which_forces_of_closures_are_determined() -> None:
    """A pin in space carries forces in the plane only; a ball carries all, and what hangs on one hinge nothing else."""
    named = {
        "four_bar": ("pin: force x", "pin: force y"),
        "sr400": ("j9: force x", "j9: force y"),
    }
    for name, components in named.items():
        found = robot_function("constraint_forces", example(name), ())
        assert found.axes == (components,)
        assert "undetermined" not in found.meaning
    weld = robot_function(
        "constraint_forces", linkages.closed_chain(ClosureKind.WELD), ()
    )
    assert len(weld.axes[0]) == 6
    assert [a.name for a in weld.arguments] == [
        "q",
        "qd",
        "qdd",
        "standard_parameters",
        "symbols",
    ]


@pytest.fixture(scope="module")
def biped() -> tuple[Mechanism, mujoco.MjModel]:
    model = mujoco.MjModel.from_xml_path(str(LOOPS / "biped.xml"))
    model.dof_armature[:] = 0
    return example("biped.xml"), model


class Simulated:
    """A mechanism in MuJoCo, with the coordinates of ours."""

    def __init__(self, mechanism: Mechanism, model: mujoco.MjModel) -> None:
        self.mechanism, self.model, self.data = mechanism, model, mujoco.MjData(model)
        names = [model.joint(k).name for k in range(model.njnt)]
        order = {name: k for k, name in enumerate(mechanism.velocities)}
        self.dofs: list[int] = []
        for k, name in enumerate(names):
            several = {
                mujoco.mjtJoint.mjJNT_FREE: ("tx", "ty", "tz", "r.x", "r.y", "r.z")
            }
            several[mujoco.mjtJoint.mjJNT_BALL] = ("x", "y", "z")
            parts = several.get(mujoco.mjtJoint(model.jnt_type[k]), ())
            self.dofs += (
                [order[f"{name}.{part}"] for part in parts] if parts else [order[name]]
            )

    def at(self, q: FloatArray, qd: FloatArray) -> None:
        """Both list coordinates in the order of bodies, quaternions with w first."""
        self.data.qpos[:], self.data.qvel[:] = q, qd[self.dofs]
        mujoco.mj_forward(self.model, self.data)

    def jacobian(self) -> FloatArray:
        rows = self.data.efc_J.reshape(self.data.nefc, self.model.nv)[: self.data.ne]
        return self.ours(rows.T).T

    def ours(self, values: FloatArray) -> FloatArray:
        found = np.zeros_like(values)
        found[self.dofs] = values
        return found

    def mass(self) -> FloatArray:
        full, column = np.zeros((self.model.nv, self.model.nv)), np.zeros(self.model.nv)
        for k, unit in enumerate(np.eye(self.model.nv)):
            mujoco.mj_mulM(self.model, self.data, column, unit)
            full[:, k] = column
        return self.ours(self.ours(full).T)


def test_a_biped_moves_as_in_mujoco(biped: tuple[Mechanism, mujoco.MjModel]) -> None:
    mechanism, model = biped
    simulated, free = Simulated(mechanism, model), independent_columns(mechanism)
    zeta = np.array([value or 0.0 for value in mechanism.standard_values()])
    functions = Functions(mechanism, zeta)
    q, qd, _ = closed_states(mechanism, 2)
    state = {"q": q, "qd": qd[:, free]}
    mass, held = (
        functions("mass_matrix", **state),
        functions("coriolis", **state) + functions("gravity", **state),
    )
    y = np.random.default_rng(4).normal(size=held.shape)
    moved = functions("forward_dynamics", **state, y=y)
    bound = [k for k in range(len(mechanism.velocities)) if k not in free]
    h = 1e-5
    for sample in range(len(q)):
        opened = []
        for sign in (1, -1):
            there = (
                q[sample]
                + sign
                * h
                * position_rates(mechanism, q[sample][None], qd[sample][None])[0]
            )
            simulated.at(normalised(mechanism, there[None])[0], qd[sample])
            opened.append(simulated.jacobian() @ qd[sample])
        simulated.at(q[sample], qd[sample])
        jacobian, tree = simulated.jacobian(), simulated.mass()
        G = np.zeros((len(mechanism.velocities), len(free)))
        G[free] = np.eye(len(free))
        G[bound] = -np.linalg.lstsq(jacobian[:, bound], jacobian[:, free], rcond=1e-9)[
            0
        ]
        close(mass[sample], G.T @ tree @ G, 1e-7)
        extra = np.zeros(len(mechanism.velocities))
        extra[bound] = -np.linalg.lstsq(
            jacobian[:, bound], (opened[0] - opened[1]) / (2 * h), rcond=1e-9
        )[0]
        bias = G.T @ (simulated.ours(simulated.data.qfrc_bias) + tree @ extra)
        close(held[sample], bias, 1e-6)
        caused = np.linalg.solve(G.T @ tree @ G, y[sample] - bias)
        close(moved[sample], caused, 1e-5)


@pytest.mark.parametrize("mechanism", ALL[::3])
def test_positions_are_closed_by_newton_steps(mechanism: Mechanism | str) -> None:
    mechanism = made(mechanism)
    functions, assembly = (
        Functions(mechanism, random_parameters(mechanism)),
        Assembly(mechanism),
    )
    q = regular_states(functions, 5)[0]
    away = normalised(
        mechanism, q + np.random.default_rng(2).uniform(-1e-2, 1e-2, q.shape)
    )
    if all(
        "." not in n for n in mechanism.independent_velocities
    ):  # a part of a ball cannot be held
        held = [mechanism.positions.index(n) for n in assembly.independent_positions]
        away[:, held] = q[:, held]
    for _ in range(4):
        away = functions("closed_positions", q=away)
    assert np.abs(assembly.closures.at(away)[0]).max() < 1e-12
    if all("." not in n for n in mechanism.independent_velocities):
        close(away, q, 1e-8)


def test_singular_positions_have_no_pivot() -> None:
    """The rocker of a crank-rocker cannot drive it where crank and coupler are in line."""
    mechanism = linkages.four_bar("rocker")
    functions = Functions(mechanism, np.zeros(30))
    crank = np.arccos((0.4**2 + 0.5**2 - 0.3**2) / (2 * 0.4 * 0.5))
    end = 0.5 * np.array([np.cos(crank), np.sin(crank)]) - [0.4, 0.0]
    q = np.array([[crank, 0.0, np.arctan2(end[1], end[0])]])
    assert functions("closure_pivots", q=q).min() < 1e-14
    assert functions("closure_pivots", q=closed_states(mechanism, 6)[0]).min() > 1e-4
    base = ec.base_parameters(mechanism)
    with pytest.raises(
        InputError, match=r"sample 0 is a singular configuration.*'(crank|coupler)'"
    ):
        base.mass_matrix(q, np.ones(base.rank))


@pytest.mark.parametrize("name", LOOP_FUNCTIONS)
def test_trees_have_no_functions_of_loops(name: str) -> None:
    tree = ec.load("examples/double_pendulum.yaml")
    with pytest.raises(
        InputError, match=f"{name} is a function of mechanisms with loops"
    ):
        robot_function(name, tree, ())


CALLS: dict[str, Callable[[ec.BaseModel, FloatArray], FloatArray]] = {
    "mass_matrix": lambda base, z: base.mass_matrix([[0.9]], z),
    "gravity": lambda base, z: base.gravity([[0.9]], z),
    "coriolis": lambda base, z: base.coriolis([[0.9]], [[2.0]], z),
    "effects": lambda base, z: base.effects([[0.9]], [[2.0]], z),
    "derivatives": lambda base, z: base.inverse_dynamics_derivatives(
        [[0.9]], [[2.0]], [[3.0]], z
    )[0],
    "forces": lambda base, _: base.constraint_forces(
        [[0.9]], [[2.0]], [[3.0]], np.ones(30)
    ),
    "entries": lambda base, _: base.regressor_entries([[0.9]], [[2.0]], [[3.0]]),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS.keys())
def test_base_models_take_independent_states(
    call: Callable[[ec.BaseModel, FloatArray], FloatArray],
) -> None:
    base = four_bar()
    found = call(base, np.linspace(0.1, 0.8, base.rank))
    assert found.shape[0] == 1
    assert np.isfinite(found).all()


@cache
def four_bar() -> ec.BaseModel:
    return base_of("loops/four_bar")
