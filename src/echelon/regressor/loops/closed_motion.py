"""Motion of a mechanism with loops in double precision: what follows from the motion of its independent coordinates.

The dependent velocities solve the closure equations' Jacobian.  Loops may have redundant constraints, as a planar
four-bar has in space, so there may be more equations than unknowns; but their rank must be the number of unknowns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.output import Cut
from echelon.mechanism.values import symbol_values
from echelon.program.schedule import FloatArithmetic, Schedule
from echelon.program.tape import Program
from echelon.regressor.loops.closure_values import ClosureValues
from echelon.regressor.probes import Probes, virtual_motion
from echelon.regressor.steps import Recorder

RANK_TOLERANCE = 1e-6
"""Singular values below this part of the largest one count as zero."""

CLOSED = 1e-6
"""Given states may miss the closure equations by this part of the mechanism's size."""

_CONSISTENT = 1e-4  # redundant constraints of states that are closed roughly agree roughly


class ClosedMotion:
    """Velocities and accelerations in closed configurations.

    Parameters
    ----------
    mechanism : Mechanism
    symbols : mapping of str to float, optional
        Values that replace or complete those of the mechanism.

    Attributes
    ----------
    mechanism : Mechanism
    closures : ClosureValues
    """

    def __init__(self, mechanism: Mechanism, symbols: Mapping[str, float] | None = None) -> None:
        self.mechanism, self.closures = mechanism, ClosureValues(mechanism, symbols)
        self.symbols = symbols
        names = mechanism.velocities
        self._independent = [names.index(name) for name in mechanism.independent_velocities]
        self._dependent = [k for k in range(len(names)) if k not in self._independent]

    def mobility(self, q: Floats, tolerance: float = RANK_TOLERANCE) -> npt.NDArray[np.intp]:
        """Degrees of freedom in closed configurations, shape (N,).

        Parameters
        ----------
        q : array of shape (N, positions)
        tolerance : float
            Singular values below this part of the largest one count as zero.
        """
        _, jacobian = self.closures.at(q)
        velocities = len(self.mechanism.velocities)
        singular = np.linalg.svd(jacobian[:, :, :velocities], compute_uv=False)
        freedoms: npt.NDArray[np.intp] = velocities - (singular > tolerance * singular[:, :1]).sum(axis=1)
        return freedoms

    def free_velocities(self, q: Floats) -> Floats:
        """Orthonormal velocities that keep the loops closed in one configuration, shape (velocities, freedoms)."""
        jacobian = self.closures.at(q[None])[1][0, :, : len(self.mechanism.velocities)]
        _, singular, turned = np.linalg.svd(jacobian)
        free: Floats = turned[(singular > RANK_TOLERANCE * singular.max(initial=0.0)).sum() :].T
        return free

    def velocities(self, q: Floats, qd_independent: Floats) -> Floats:
        """Velocities of all coordinates, shape (N, velocities), from those of the independent ones, (N, independent).

        Raises
        ------
        InputError
            If the independent coordinates do not determine the others; names the sample.
        """
        return self._completed(q, qd_independent, np.zeros(len(self.closures.owners)))

    def accelerations(self, q: Floats, qd: Floats, qdd_independent: Floats) -> Floats:
        """Accelerations of all coordinates, from all velocities and the independent accelerations.

        Raises
        ------
        InputError
            If the independent coordinates do not determine the others; names the sample.
        """
        return self._completed(q, qdd_independent, self.closures.bias(q, qd))

    def virtual_velocities(self, q: Floats) -> Floats:
        """Virtual velocities of all coordinates that belong to each output, shape (N, velocities, outputs).

        Raises
        ------
        InputError
            If an output is not determined by the motion because constraints are redundant; names the output.
        """
        freedoms = list(dict.fromkeys(name for motion in self.chosen_speeds for name in motion))
        given = [self.closures.freedoms.index(name) for name in freedoms]
        speeds = np.array([[motion.get(name, 0.0) for motion in self.chosen_speeds] for name in freedoms])
        speeds = speeds.reshape(len(freedoms), len(self.chosen_speeds)) / self.closures.units[given, None]
        _, jacobian = self.closures.at(q)
        driven = jacobian[:, :, given] @ speeds
        solved = -self._solved(jacobian, driven)
        self._check_determined(driven + jacobian[:, :, self._dependent] @ solved, driven)
        result = np.zeros((len(q), len(self.closures.freedoms), len(self.chosen_speeds)))
        result[:, given], result[:, self._dependent] = speeds, solved
        result *= self.closures.units[:, None]
        return result[:, : len(self.mechanism.velocities)]

    def check_closed(self, q: Floats, qd: Floats, qdd: Floats) -> None:
        """Check that states keep the loops closed.

        Raises
        ------
        InputError
            If they do not; names the sample and the closure.
        """
        units = self.closures.units[: qd.shape[1]]
        values, jacobian = self.closures.at(q)
        jacobian = jacobian[:, :, : qd.shape[1]]
        self._check_small(values, np.ones(len(q)), "positions")
        rates = (jacobian @ (qd / units)[:, :, None])[:, :, 0]
        self._check_small(rates, largest(qd / units), "velocities")
        bias = self.closures.bias(q, qd)
        gained = (jacobian @ (qdd / units)[:, :, None])[:, :, 0] + bias
        self._check_small(gained, largest(qdd / units) + largest(bias), "accelerations")

    # -- equations -------------------------------------------------------------------------------------------------

    def _completed(self, q: Floats, independent: Floats, bias: Floats) -> Floats:
        """All x with J x + bias = 0, from the independent ones."""
        units = self.closures.units[: len(self.mechanism.velocities)]
        _, jacobian = self.closures.at(q)
        given = independent / units[self._independent]
        driven = (jacobian[:, :, self._independent] @ given[:, :, None])[:, :, 0] + bias
        result = np.zeros((len(q), len(units)))
        result[:, self._independent] = given
        result[:, self._dependent] = -self._solved(jacobian, driven[:, :, None])[:, :, 0]
        result *= units
        return result

    def _solved(self, jacobian: Floats, right: Floats) -> Floats:
        """Least-squares solutions for the dependent velocities."""
        names, unknown = self.mechanism.velocities, len(self._dependent)
        left, singular, turned = np.linalg.svd(jacobian[:, :, self._dependent], full_matrices=False)
        rank = (singular > RANK_TOLERANCE * singular[:, :1]).sum(axis=1)
        if (rank < unknown).any():
            sample = int(np.argmax(rank < unknown))
            null = np.linalg.svd(jacobian[sample][:, self._dependent])[2][-1]
            loose = names[self._dependent[int(np.abs(null).argmax())]]
            raise InputError(
                f"sample {sample} is a singular configuration: the independent coordinates "
                f"({', '.join(self.mechanism.independent_velocities)}) do not determine the motion of '{loose}' there"
            )
        solved: Floats = turned.swapaxes(1, 2) @ ((left.swapaxes(1, 2) @ right) / singular[:, :, None])
        return solved

    @cached_property
    def chosen_speeds(self) -> Sequence[Mapping[str, float]]:
        """For every output, the virtual velocities of the freedoms that the outputs determine."""
        program = Program()
        probes = Probes(self.mechanism, Recorder(self.mechanism, program))
        found: list[Mapping[str, float]] = []
        for output in self.mechanism.outputs:
            chosen = virtual_motion(self.mechanism, probes, {output.name: program.one}).chosen
            schedule = Schedule(program, [speed.node for speed in chosen.values()])
            names = {n: program.inputs[n].name for n in schedule.leaves}
            values = symbol_values(self.mechanism, names.values(), self.symbols)
            leaves = {n: np.full(1, values[name]) for n, name in names.items()}
            speeds = schedule.run(FloatArithmetic(), leaves, 1)[:, 0]
            found.append(dict(zip(chosen, map(float, speeds), strict=True)))
        return found

    # -- checks ----------------------------------------------------------------------------------------------------

    def _check_determined(self, missed: Floats, driven: Floats) -> None:
        off = (np.abs(missed).max(axis=1) > _CONSISTENT * np.abs(driven).max(axis=1)).any(axis=0)
        if not off.any():
            return
        output = self.mechanism.outputs[int(off.argmax())]
        if any(isinstance(channel, Cut) for channel, _ in output.terms):
            raise InputError(
                f"output '{output.name}' is not determined by the motion: the loops have redundant constraints, which "
                "share the load in a way that rigid bodies do not tell"
            )
        names = ", ".join(self.mechanism.independent_velocities)
        raise InputError(f"the coordinates {names} are not independent: the loops do not let them move one by one")

    def _check_small(self, values: Floats, scale: Floats, what: str) -> None:
        off = np.abs(values).max(axis=1) > CLOSED * np.maximum(scale, 1.0)
        if off.any():
            sample = int(np.argmax(off))
            raise InputError(
                f"the {what} of sample {sample} do not keep the loops closed: {self.opening(values[sample])}; give "
                f"those of the independent coordinates only ({', '.join(self.mechanism.independent_velocities)})"
            )

    def opening(self, values: Floats) -> str:
        """What closure equations miss most, in words."""
        closure, size, unit = self.widest(values)
        return f"closure '{closure}' is off by {size:.3g} {unit}"

    def widest(self, values: Floats) -> tuple[str, float, str]:
        """The closure that equations miss most, by how much, and in which unit."""
        worst = int(np.abs(values).argmax())
        if self.closures.is_length[worst]:
            return self.closures.owners[worst], float(abs(values[worst]) * self.closures.length), "m"
        return self.closures.owners[worst], float(abs(values[worst])), "rad"


def largest(values: Floats) -> Floats:
    """Largest absolute value of every sample."""
    size: Floats = np.abs(values).max(axis=1, initial=0.0)
    return size
