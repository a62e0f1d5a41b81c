"""The closure equations of a mechanism with loops in double precision, and the motions that they allow.

The dependent velocities solve the closure equations' Jacobian.  Loops may have redundant constraints, as a planar
four-bar has in space, so there may be more equations than unknowns; but their rank must be the number of unknowns.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Generic, NoReturn, TypeVar

import numpy as np
import numpy.typing as npt

from echelon.algebra import BLOCK, FloatArithmetic, Program, Schedule, StagedSchedule
from echelon.loops.closures import ClosureEquations, record_closures
from echelon.robot import (
    Mechanism,
    Motion,
    MotionKind,
    Probes,
    Recorder,
    Symbol,
    characteristic_length,
    cut_names,
    quaternion_times,
    shown_loops,
    symbol_values,
    virtual_motion,
)
from echelon.shared import Floats, InputError, Integers

NOISE = 1e-12
"""Part of the largest of some numbers, or of 1, that rounding of doubles makes on the way to them."""

NEGLIGIBLE = 1e-6
"""Part of a whole up to which it counts as nothing: singular values, moves, and what given states leave open."""

CLEAR = 1e-3
"""Part of a whole from which on it is something beyond doubt, whatever rounding and bad conditions make."""

CLOSED = 1e-11
"""What closures are open by where they count as closed, in doubles or for rounding of frames; rad or lengths."""

EXPLAINED = 5
"""Times the last decimal: what rounding of all numbers of a file together moves closures and motions by."""

RATE = 2.0
"""Largest random velocity, rad/s or characteristic lengths per second; of accelerations alike."""

REMEMBERED = 8
"""Mechanisms of which what takes time is kept."""

COMPLEX_STEP = 1e-30
"""Imaginary step of a derivative: its square vanishes against 1, and nothing is subtracted."""

T = TypeVar("T")
_Numbers = npt.NDArray[np.inexact]


class _ComplexArithmetic(FloatArithmetic):
    dtype: npt.DTypeLike = np.complex128


@dataclass(frozen=True)
class Keyed(Generic[T]):
    """A subject that is known again by a part of it: one derivation asks for the same things from many places."""

    part: Hashable
    subject: T = field(compare=False)


def identity(mechanism: Mechanism) -> Hashable:
    """All that closed configurations of a mechanism depend on."""
    stated = (
        frozenset(values.items()) for values in (mechanism.symbols, mechanism.assembly)
    )
    return (
        mechanism.bodies,
        mechanism.couplings,
        mechanism.closures,
        mechanism.rounding,
        *stated,
    )


@lru_cache(maxsize=REMEMBERED)
def _recorded(known: Keyed[Mechanism]) -> tuple[ClosureEquations, StagedSchedule]:
    recorder = Recorder(known.subject, Program())
    return _scheduled(
        record_closures(known.subject, recorder, Probes(known.subject, recorder))
    )


def _scheduled(equations: ClosureEquations) -> tuple[ClosureEquations, StagedSchedule]:
    return equations, StagedSchedule(
        equations.program, [*equations.equations, *equations.jacobian.values()]
    )


class ClosureValues:
    """The closure equations of a mechanism: values, Jacobian, and the accelerations that velocities alone cause.

    Lengths count in units of the mechanism's characteristic length, so that all equations and all speeds are alike.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        symbols: Mapping[str, float] | None = None,
        equations: ClosureEquations | None = None,
    ) -> None:
        self.mechanism = mechanism
        moving = Keyed(
            (
                mechanism.bodies,
                mechanism.couplings,
                mechanism.closures,
                mechanism.measured,
            ),
            mechanism,
        )
        equations, self._schedule = (
            _recorded(moving) if equations is None else _scheduled(equations)
        )
        used = [
            self._schedule.program.inputs[node]
            for node in self._schedule.constants.leaves
        ]
        known = symbol_values(
            mechanism, [given.name for given in used if given.role == "symbol"], symbols
        )
        self._kept = self._constant(
            {name: np.array([value]) for name, value in known.items()}, 1
        )
        self.rows: Sequence[int] = range(len(equations.owners))
        self._columns = {f"q[{name}]": k for k, name in enumerate(mechanism.positions)}
        # velocity coordinates, then the cuts of sensors
        cuts = cut_names(mechanism)
        self.freedoms = (*mechanism.velocities, *cuts.values())
        place = {name: k for k, name in enumerate(self.freedoms)}
        self._entries = [(row, place[name]) for row, name in equations.jacobian]
        self._equations = len(equations.owners)
        self.owners: tuple[str, ...] = equations.owners
        self.length = _length(mechanism, symbols or {})
        self.is_length = np.array(equations.is_length)
        sliding = {
            m.name for m in mechanism.motions if m.kind is MotionKind.TRANSLATION
        }
        sliding |= {name for cut, name in cuts.items() if not cut.angular}
        self.units = np.array(
            [self.length if name in sliding else 1.0 for name in self.freedoms]
        )

    def _constant(self, symbols: Mapping[str, Floats], count: int) -> dict[int, Floats]:
        """Nodes that depend on symbols alone, at one set of their values or one for every configuration."""
        return self._schedule.kept(FloatArithmetic(), symbols, count)

    def with_rows(self, rows: Sequence[int]) -> ClosureValues:
        """Some of the equations: independent ones, where rounding makes the others contradict them."""
        other = copy(self)
        other.rows, other.owners = rows, tuple(self.owners[row] for row in rows)
        other.is_length = self.is_length[list(rows)]
        return other

    def with_values(self, symbols: Mapping[str, Floats]) -> ClosureValues:
        """The equations at other values of the symbols, one for every configuration, in the same units."""
        other = copy(self)
        other._kept = other._constant(symbols, len(next(iter(symbols.values()))))
        return other

    def at(
        self, q: Floats, chosen: Integers | slice = slice(None)
    ) -> tuple[Floats, Floats]:
        """Values of the equations, shape (N, equations), and their Jacobian by freedoms, (N, equations, freedoms).

        Where every configuration has values of the symbols of its own, those of the chosen ones count.
        """
        values, jacobian = self._run(q, FloatArithmetic(), chosen)
        jacobian[np.abs(jacobian) < NOISE] = (
            0  # equations that hold whatever moves have no largest singular value
        )
        return values.real, jacobian.real

    def bias(self, q: Floats, qd: Floats) -> Floats:
        """Second derivatives of the equations by time while the velocities stay as they are, (N, equations)."""
        velocities = qd.shape[1]
        _, jacobian = self._run(
            q + 1j * COMPLEX_STEP * position_rates(self.mechanism, q, qd),
            _ComplexArithmetic(),
        )
        rates = jacobian.imag[:, :, :velocities] / COMPLEX_STEP
        result: Floats = (rates @ (qd / self.units[:velocities])[:, :, None])[:, :, 0]
        return result

    def _run(
        self,
        q: _Numbers,
        arithmetic: FloatArithmetic,
        chosen: Integers | slice = slice(None),
    ) -> tuple[_Numbers, _Numbers]:
        inputs, count = self._schedule.program.inputs, self._equations
        values = np.zeros((len(q), count), dtype=arithmetic.dtype)
        jacobian = np.zeros((len(q), count, len(self.freedoms)), dtype=arithmetic.dtype)
        for start in range(0, len(q), BLOCK):
            block = slice(start, min(start + BLOCK, len(q)))
            leaves = {
                n: q[block, self._columns[inputs[n].name]]
                for n in self._schedule.leaves
            }
            leaves |= {
                n: x if len(x) == 1 else x[chosen][block] for n, x in self._kept.items()
            }
            table = self._schedule.moving.run(
                arithmetic, leaves, block.stop - block.start
            )
            values[block] = table[:count].T
            for (row, column), value in zip(self._entries, table[count:], strict=True):
                jacobian[block, row, column] = value
        kept = list(self.rows)
        row_units = np.where(self.is_length, self.length, 1.0)
        return values[:, kept] / row_units, jacobian[:, kept] * self.units / row_units[
            :, None
        ]


class ClosedMotion:
    """How a mechanism can move in closed configurations."""

    def __init__(
        self,
        mechanism: Mechanism,
        symbols: Mapping[str, float] | None = None,
        equations: ClosureEquations | None = None,
    ) -> None:
        self.mechanism = mechanism
        self.closures = ClosureValues(mechanism, symbols, equations)
        self.symbols = symbols
        self.explained = (
            EXPLAINED * mechanism.rounding
        )  # what rounding opens closures by, rad or lengths
        # singular values below this part of the largest one count as zero
        self.tolerance = max(NEGLIGIBLE, self.explained)
        names = mechanism.velocities
        self._independent = [
            names.index(name) for name in mechanism.independent_velocities
        ]
        self._dependent = [k for k in range(len(names)) if k not in self._independent]

    @property
    def speed_units(self) -> Floats:
        """Units of the velocity coordinates' speeds, shape (velocities,)."""
        return self.closures.units[: len(self.mechanism.velocities)]

    def jacobian(self, q: Floats) -> Floats:
        """Derivatives of the closure equations by velocities, (N, equations, velocities)."""
        return self.closures.at(q)[1][:, :, : len(self.mechanism.velocities)]

    def singular_values(
        self, q: Floats, columns: Sequence[int] | slice = slice(None)
    ) -> Floats:
        """Singular values of the Jacobian, or of some of its columns, about the largest, shape (N, values)."""
        found = np.linalg.svd(self.jacobian(q)[:, :, columns], compute_uv=False)
        relative: Floats = found / np.maximum(found[:, :1], NOISE)
        return relative

    def mobility(self, q: Floats) -> npt.NDArray[np.intp]:
        """Degrees of freedom in closed configurations, shape (N,)."""
        ranks: npt.NDArray[np.intp] = (self.singular_values(q) > self.tolerance).sum(
            axis=1
        )
        return len(self.mechanism.velocities) - ranks

    def free_velocities(self, q: Floats) -> Floats:
        """Orthonormal velocities that keep the loops closed in one configuration, shape (velocities, freedoms)."""
        _, singular, turned = np.linalg.svd(self.jacobian(q[None])[0])
        free: Floats = turned[
            (singular > self.tolerance * singular.max(initial=0.0)).sum() :
        ].T
        return free

    def determined(self, q: Floats) -> Floats:
        """The smallest singular value of the equations for the dependent velocities, about the largest, shape (N,)."""
        unknown = len(self._dependent)
        if unknown:
            return self.singular_values(q, self._dependent)[:, unknown - 1]
        return np.ones(len(q))

    def virtual_velocities(self, q: Floats) -> Floats:
        """Virtual velocities of all coordinates that belong to each output, shape (N, velocities, outputs)."""
        freedoms = list(
            dict.fromkeys(name for motion in self.chosen_speeds for name in motion)
        )
        given = [self.closures.freedoms.index(name) for name in freedoms]
        speeds = np.array(
            [
                [motion.get(name, 0.0) for motion in self.chosen_speeds]
                for name in freedoms
            ]
        )
        speeds = (
            speeds.reshape(len(freedoms), len(self.chosen_speeds))
            / self.closures.units[given, None]
        )
        _, jacobian = self.closures.at(q)
        driven = jacobian[:, :, given] @ speeds
        solved = -self._solved(jacobian, driven)
        self._check_determined(
            driven + jacobian[:, :, self._dependent] @ solved, driven
        )
        result = np.zeros(
            (len(q), len(self.closures.freedoms), len(self.chosen_speeds))
        )
        result[:, given], result[:, self._dependent] = speeds, solved
        result *= self.closures.units[:, None]
        return result[:, : len(self.mechanism.velocities)]

    def _solved(self, jacobian: Floats, right: Floats) -> Floats:
        """Least-squares solutions for the dependent velocities."""
        names, unknown = self.mechanism.velocities, len(self._dependent)
        left, singular, turned = np.linalg.svd(jacobian[:, :, self._dependent])
        loose = (singular > self.tolerance * singular[:, :1]).sum(axis=1) < unknown
        if loose.any():
            sample = int(loose.argmax())
            self._refuse_singular(
                sample, names[self._dependent[int(np.abs(turned[sample, -1]).argmax())]]
            )
        across: Floats = (left[:, :, :unknown].swapaxes(1, 2) @ right) / singular[
            :, :, None
        ]
        return turned.swapaxes(1, 2) @ across

    @cached_property
    def chosen_speeds(self) -> Sequence[Mapping[str, float]]:
        """For every output, the virtual velocities of the freedoms that the outputs determine."""
        program = Program()
        probes = Probes(self.mechanism, Recorder(self.mechanism, program))
        found: list[Mapping[str, float]] = []
        for output in self.mechanism.outputs:
            chosen = virtual_motion(
                self.mechanism, probes, {output.name: program.one}
            ).chosen
            schedule = Schedule(program, [speed.node for speed in chosen.values()])
            names = {n: program.inputs[n].name for n in schedule.leaves}
            values = symbol_values(self.mechanism, names.values(), self.symbols)
            leaves = {n: np.full(1, values[name]) for n, name in names.items()}
            speeds = schedule.run(FloatArithmetic(), leaves, 1)[:, 0]
            found.append(dict(zip(chosen, map(float, speeds), strict=True)))
        return found

    # -- checks ----------------------------------------------------------------------------------------------------

    def _refuse_singular(self, sample: int, loose: str) -> NoReturn:
        raise InputError(
            f"sample {sample} is a singular configuration of {shown_loops(self.mechanism, loose)}: the independent "
            f"coordinates ({', '.join(self.mechanism.independent_velocities)}) do not determine the motion of "
            f"'{loose}' there.  Leave the sample out, or state other independent coordinates"
        )

    def _check_determined(self, missed: Floats, driven: Floats) -> None:
        # an output may move nothing that the loops are closed by, such as a body that is folded onto a closing joint
        scale = np.maximum(np.abs(driven).max(axis=1), NEGLIGIBLE)
        off = (np.abs(missed).max(axis=1) > CLEAR * scale).any(axis=0)
        if not off.any():
            return
        output = self.mechanism.outputs[int(off.argmax())]
        if output.cuts:
            raise InputError(
                f"output '{output.name}' is not determined by the motion: "
                f"{shown_loops(self.mechanism)} have redundant constraints, between which rigid-body dynamics does "
                "not divide the load; measure fewer components, or give a closure a kind that holds less"
            )
        names = ", ".join(self.mechanism.independent_velocities)
        raise InputError(
            f"the coordinates {names} are not independent: {shown_loops(self.mechanism)} do not let "
            f"'{output.name}' move alone (missed by {np.abs(missed).max(initial=0.0):.1g}); leave  independent  out"
        )

    def opening(self, q: Floats) -> str:
        """Message about the largest closure error of a configuration (positions,)."""
        closure, size, unit = self.widest(q)
        return f"closure '{closure}' is off by {size:.3g} {unit} between {self.mechanism.ends(closure)}"

    def widest(self, q: Floats) -> tuple[str, float, str]:
        """The closure that a configuration (positions,) opens most, by how much, and in which unit."""
        values = self.closures.at(q[None])[0][0]
        worst = int(np.abs(values).argmax())
        if self.closures.is_length[worst]:
            return (
                self.closures.owners[worst],
                float(abs(values[worst]) * self.closures.length),
                "m",
            )
        return self.closures.owners[worst], float(abs(values[worst])), "rad"


def largest(values: Floats) -> Floats:
    """Largest absolute value of every sample."""
    size: Floats = np.abs(values).max(axis=1, initial=0.0)
    return size


def position_rates(mechanism: Mechanism, q: Floats, qd: Floats) -> Floats:
    """Rates of the position coordinates; a quaternion's is half its product with the velocity."""
    result = np.zeros_like(q)
    for motion, place, speeds in places(mechanism):
        rate = qd[:, speeds]
        if motion.kind is MotionKind.BALL:
            rate = np.stack(quaternion_times(q[:, place].T, rate.T), axis=1) / 2
        result[:, place] = rate
    return result


def normalised(mechanism: Mechanism, q: Floats) -> Floats:
    """Positions with unit quaternions."""
    result = q.copy()
    for motion, place, _ in places(mechanism):
        if motion.kind is MotionKind.BALL:
            result[:, place] /= np.linalg.norm(q[:, place], axis=1, keepdims=True)
    return result


def places(mechanism: Mechanism) -> Iterator[tuple[Motion, slice, slice]]:
    """Motions that no coupling makes dependent, with the places of their positions and of their velocities."""
    position = velocity = 0
    for motion in mechanism.free_motions:
        ends = position + len(motion.positions), velocity + len(motion.velocities)
        yield motion, slice(position, ends[0]), slice(velocity, ends[1])
        position, velocity = ends


def _length(mechanism: Mechanism, symbols: Mapping[str, float]) -> float:
    given = {name: Symbol(name, value) for name, value in symbols.items()}
    return characteristic_length(
        replace(mechanism, symbols={**mechanism.symbols, **given})
    )
