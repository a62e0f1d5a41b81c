"""Closure equations in double precision: values, Jacobian, and the accelerations that velocities alone cause.

Lengths count in units of the mechanism's characteristic length, so that all equations and all speeds are alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism, Symbol
from echelon.mechanism.values import characteristic_length, symbol_values
from echelon.program.schedule import FloatArithmetic, Schedule
from echelon.program.tape import Program
from echelon.regressor.loops.closures import record_closures
from echelon.regressor.probes import Probes
from echelon.regressor.steps import Recorder

_Numbers = npt.NDArray[np.inexact]

_BLOCK = 1024  # samples evaluated together, so that the table of intermediate values stays small
_STEP = 1e-30  # of a complex step: its square vanishes against 1, and nothing is subtracted


class _ComplexArithmetic(FloatArithmetic):
    dtype: npt.DTypeLike = np.complex128


class ClosureValues:
    """Evaluates the closure equations of a mechanism.

    Parameters
    ----------
    mechanism : Mechanism
    symbols : mapping of str to float, optional
        Values that replace or complete those of the mechanism.

    Attributes
    ----------
    freedoms : tuple of str
        Velocity coordinates, then the cuts of sensors.
    owners : tuple of str
        Name of the closure of every equation.
    length : float
        Characteristic length, m.
    units : array of shape (freedoms,)
        Unit of each freedom's speed: the characteristic length where it slides.
    is_length : array of bool, shape (equations,)
        Whether an equation is about a length, not about a direction.

    Raises
    ------
    InputError
        If a symbol has no value, or a given one is not a symbol of the mechanism.
    """

    def __init__(self, mechanism: Mechanism, symbols: Mapping[str, float] | None = None) -> None:
        self.mechanism = mechanism
        program = Program()
        recorder = Recorder(mechanism, program)
        probes = Probes(mechanism, recorder)
        equations = record_closures(mechanism, recorder, probes)
        self._schedule = Schedule(program, [*equations.equations, *equations.jacobian.values()])
        used = [program.inputs[n] for n in self._schedule.leaves]
        self._constants = symbol_values(mechanism, [i.name for i in used if i.role == "symbol"], symbols)
        self._columns = {f"q[{name}]": k for k, name in enumerate(mechanism.positions)}
        self.freedoms = (*mechanism.velocities, *probes.names.values())
        place = {name: k for k, name in enumerate(self.freedoms)}
        self._entries = [(row, place[name]) for row, name in equations.jacobian]
        self.owners, self.length = equations.owners, _length(mechanism, symbols or {})
        self.is_length = _lengths(mechanism)
        sliding = {m.name for m in mechanism.motions if m.kind is MotionKind.TRANSLATION}
        sliding |= {name for cut, name in probes.names.items() if not cut.angular}
        self.units = np.array([self.length if name in sliding else 1.0 for name in self.freedoms])

    def at(self, q: Floats) -> tuple[Floats, Floats]:
        """Values of the equations, shape (N, equations), and their Jacobian by freedoms, (N, equations, freedoms)."""
        values, jacobian = self._run(q, FloatArithmetic())
        return values.real, jacobian.real

    def bias(self, q: Floats, qd: Floats) -> Floats:
        """Second derivatives of the equations by time while the velocity coordinates stay as they are, (N, equations).

        Parameters
        ----------
        q : array of shape (N, positions)
        qd : array of shape (N, velocities)
        """
        velocities = qd.shape[1]
        _, jacobian = self._run(q + 1j * _STEP * position_rates(self.mechanism, q, qd), _ComplexArithmetic())
        rates = jacobian.imag[:, :, :velocities] / _STEP
        result: Floats = (rates @ (qd / self.units[:velocities])[:, :, None])[:, :, 0]
        return result

    def _run(self, q: _Numbers, arithmetic: FloatArithmetic) -> tuple[_Numbers, _Numbers]:
        inputs, count = self._schedule.program.inputs, len(self.owners)
        values = np.zeros((len(q), count), dtype=arithmetic.dtype)
        jacobian = np.zeros((len(q), count, len(self.freedoms)), dtype=arithmetic.dtype)
        for start in range(0, len(q), _BLOCK):
            block = slice(start, min(start + _BLOCK, len(q)))
            leaves = {n: self._leaf(inputs[n].name, q[block]) for n in self._schedule.leaves}
            table = self._schedule.run(arithmetic, leaves, block.stop - block.start)
            values[block] = table[:count].T
            for (row, column), value in zip(self._entries, table[count:], strict=True):
                jacobian[block, row, column] = value
        row_units = np.where(self.is_length, self.length, 1.0)
        return values / row_units, jacobian * self.units / row_units[:, None]

    def _leaf(self, name: str, q: _Numbers) -> _Numbers:
        return np.full(len(q), self._constants[name]) if name in self._constants else q[:, self._columns[name]]


def position_rates(mechanism: Mechanism, q: Floats, qd: Floats) -> Floats:
    """Rates of the position coordinates; a quaternion's is half its product with the velocity.

    Parameters
    ----------
    mechanism : Mechanism
    q : array of shape (N, positions)
    qd : array of shape (N, velocities)
    """
    result = np.zeros_like(q)
    for motion in mechanism.motions:
        if motion.name in mechanism.dependent:
            continue
        place = mechanism.positions.index(motion.positions[0])
        speed = mechanism.velocities.index(motion.velocities[0])
        if motion.kind is not MotionKind.BALL:
            result[:, place] = qd[:, speed]
            continue
        w, vector, turning = q[:, place, None], q[:, place + 1 : place + 4], qd[:, speed : speed + 3]
        result[:, place] = -(vector * turning).sum(axis=1) / 2
        result[:, place + 1 : place + 4] = (w * turning + np.cross(vector, turning)) / 2
    return result


def normalised(mechanism: Mechanism, q: Floats) -> Floats:
    """Positions with unit quaternions."""
    result = q.copy()
    for motion in mechanism.motions:
        if motion.kind is MotionKind.BALL:
            place = mechanism.positions.index(motion.positions[0])
            result[:, place : place + 4] /= np.linalg.norm(q[:, place : place + 4], axis=1, keepdims=True)
    return result


def _lengths(mechanism: Mechanism) -> npt.NDArray[np.bool_]:
    """Whether each closure equation is about a length."""
    kinds = [closure.kind for closure in mechanism.closures]
    return np.array([part for k in kinds for part in [True] * len(k.positions) + [False] * len(k.directions)])


def _length(mechanism: Mechanism, symbols: Mapping[str, float]) -> float:
    given = {name: Symbol(name, value) for name, value in symbols.items()}
    return characteristic_length(replace(mechanism, symbols={**mechanism.symbols, **given}))
