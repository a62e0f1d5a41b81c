"""Motions that contacts allow: velocities, accelerations and virtual velocities that depend on others, recorded.

Rows u'X see no unknown force at a contact if its frame does not slip in the virtual motion u.  Positions are free, so
that these conditions are linear equations J(q) q' = 0 whose coefficients are recorded values.  They are solved by
Gauss-Jordan elimination on the program, with pivots that do not vanish modulo a random prime.  So rows stay rational
functions of free inputs, and all that serves trees serves them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial, reduce

import numpy as np

from echelon.algebra import (
    DEFAULT_SEED,
    PrimeField,
    Program,
    Scalar,
    random_generator,
    sampler_of,
)
from echelon.dynamics.frame_motion import Accelerations, accelerated, moved
from echelon.robot import (
    GROUND,
    Contact,
    ContactKind,
    Mechanism,
    Probes,
    RecordedStep,
    Recorder,
    Vec,
    VirtualMotion,
    add,
    cross,
    into_frame,
    motion_of_joints,
    scale,
    virtual_motion,
)
from echelon.shared import InputError, in_quotes


class ContactMotion:
    """Dependent rates and virtual speeds of a mechanism with contacts, on a program."""

    def __init__(self, mechanism: Mechanism, program: Program) -> None:
        self.mechanism, self.program = mechanism, program
        self._recorder = Recorder(mechanism, program)
        self._probes = Probes(mechanism, self._recorder)

    @cached_property
    def given(self) -> dict[str, Scalar]:
        """Velocities and accelerations of dependent coordinates, by the names of their inputs."""
        mechanism, program = self.mechanism, self.program
        names = mechanism.velocities
        motions = [
            motion_of_joints(mechanism, self._recorder, {name: program.one})
            for name in names
        ]
        slips = self._slips(motions, every=True)
        solved = _Solved.of(program, slips, _rare_first(slips))
        if len(solved.pivots) == len(names):
            raise InputError(
                f"the contacts {self._names} leave no motion; state fewer, or weaker kinds",
                element="contacts",
            )
        rates = solved.values(names, "qd")
        still = {f"qdd[{name}]": program.zero for name in names}
        bias = self._bias(rates | still)
        return rates | solved.values(names, "qdd", bias)

    @cached_property
    def speeds(self) -> dict[str, Scalar]:
        """Virtual speeds of dependent outputs, in which no unknown force does work."""
        names = [output.name for output in self.mechanism.outputs]
        slips = self._slips(self._motions_of_outputs, every=False)
        solved = _Solved.of(self.program, slips, _rare_first(slips))
        if len(solved.pivots) == len(names):
            raise InputError(
                f"unknown forces at {self._names} hide all outputs: measure more",
                element="contacts",
            )
        found = solved.values(names, "u")
        return {name: found[f"u[{name}]"] for name in names if f"u[{name}]" in found}

    @property
    def _names(self) -> str:
        return in_quotes([contact.name for contact in self.mechanism.contacts])

    @property
    def slips_of_outputs(self) -> list[list[Scalar]]:
        """Slip of all components, a row for each, per unit of each output's virtual velocity."""
        return self._slips(self._motions_of_outputs, every=True)

    @cached_property
    def _motions_of_outputs(self) -> list[VirtualMotion]:
        return [
            virtual_motion(
                self.mechanism, self._probes, {output.name: self.program.one}
            )
            for output in self.mechanism.outputs
        ]

    def _slips(
        self, motions: Sequence[VirtualMotion], *, every: bool
    ) -> list[list[Scalar]]:
        """Slip of the contacts, a row for each component, in motions, a column for each.

        Components that are measured are left out unless ``every`` is set.
        """
        rows = list[list[Scalar]]()
        for contact in self.mechanism.contacts:
            steps = list(self._path(contact, self._recorder))
            up = self._up(contact, steps)
            rest = (self._recorder.zeros, self._recorder.zeros)
            columns = list[tuple[Scalar, ...]]()
            for motion in motions:
                angular, linear = reduce(partial(moved, motion), steps, rest)
                columns.append(_slip(contact, angular, linear, up))
            wanted = zip(
                contact.kind.components, zip(*columns, strict=True), strict=True
            )
            rows += [
                list(row)
                for component, row in wanted
                if every or component not in contact.measured
            ]
        return rows

    def _bias(self, given: Mapping[str, Scalar]) -> list[Scalar]:
        """Rates of the slip of all components while coordinates do not accelerate."""
        recorder = Recorder(self.mechanism, self.program, given)
        ground = Accelerations(recorder.zeros, recorder.zeros, recorder.zeros)
        found = list[Scalar]()
        for contact in self.mechanism.contacts:
            steps = list(self._path(contact, recorder))
            at = reduce(accelerated, steps, ground)
            up = self._up(contact, steps)
            found += _slip(contact, at.angular_rate, at.linear, up)
        return found

    def _path(self, contact: Contact, recorder: Recorder) -> Iterable[RecordedStep]:
        """Steps from the ground to the contact's frame, those of sensors among them."""
        chain, body = [contact.body], self.mechanism.bodies[contact.body].parent
        while body != GROUND:
            chain.insert(0, body)
            body = self.mechanism.bodies[body].parent
        probes = Probes(self.mechanism, recorder)
        yield from probes.steps(GROUND, False)
        for index in chain:
            yield from probes.steps(index, True)
            yield from recorder.steps(index)
            yield from probes.steps(index, False)
        yield recorder.placement(contact.frame)

    def _up(self, contact: Contact, steps: Iterable[RecordedStep]) -> Vec | None:
        """From the ground to a rolling body's centre, in the axes of its frame; None for others."""
        if contact.kind is not ContactKind.ROLLING:
            return None
        x, y, z = (
            self.program.polynomial(component * contact.radius)
            for component in _upward(self.mechanism, contact)
        )
        return reduce(lambda v, step: into_frame(step, v), steps, (x, y, z))


def _upward(mechanism: Mechanism, contact: Contact) -> list[int]:
    """Unit vector against gravity, which is along an axis of the base frame."""
    numbers = [g.number for g in mechanism.gravity or ()]
    if sum(g != 0 for g in numbers) != 1 or None in numbers:
        raise InputError(
            "rolling needs gravity along an axis of the base frame, by which up is known",
            element=f"contact '{contact.name}'",
        )
    return [0 if g == 0 else (-1 if g > 0 else 1) for g in numbers]  # type: ignore[operator]


def _slip(
    contact: Contact, angular: Vec, linear: Vec, up: Vec | None
) -> tuple[Scalar, ...]:
    """Velocity of the body where it touches, and its rotation about held axes; or the rates of both."""
    if up is not None:
        linear = add(linear, scale(cross(angular, up), up[0].program.constant(-1)))
    return (*linear, *(angular[axis] for axis in contact.kind.held_axes))


def _rare_first(rows: Sequence[Sequence[Scalar]]) -> list[int]:
    """Columns in the order in which they become dependent: those in few rows, which leave most zeros, first."""
    columns = list(zip(*rows, strict=True))
    counts = [sum(not entry.is_zero for entry in column) for column in columns]
    moving = [k for k, count in enumerate(counts) if count]
    return sorted(moving, key=lambda k: (counts[k], -k))


@dataclass(frozen=True)
class _Solved:
    """Equations A x = b with some unknowns as combinations of the others and of b."""

    program: Program
    pivots: Mapping[int, int]  # row of each dependent unknown
    rows: Sequence[Sequence[Scalar]]  # A, then the unit matrix, after the elimination
    width: int  # number of unknowns

    @classmethod
    def of(
        cls, program: Program, rows: Sequence[Sequence[Scalar]], order: Sequence[int]
    ) -> _Solved:
        """Equations solved for the unknowns that come first in an order."""
        height, width = len(rows), len(rows[0]) if rows else 0
        unit = [
            [program.one if i == j else program.zero for j in range(height)]
            for i in range(height)
        ]
        left = [[*row, *extra] for row, extra in zip(rows, unit, strict=True)]
        if not rows:
            return cls(program, {}, rows, width)
        residues, prime = _residues(program, rows)
        numbers = [
            [*map(int, values), *(int(i == j) for j in range(height))]
            for i, values in enumerate(residues)
        ]
        pivots = dict[int, int]()
        for column in order:
            free = (r for r in range(height) if r not in pivots.values())
            row = next((r for r in free if numbers[r][column]), None)
            if row is None:
                continue
            pivots[column] = row
            factor, inverse = left[row][column], pow(numbers[row][column], -1, prime)
            left[row] = [entry / factor for entry in left[row]]
            numbers[row] = [value * inverse % prime for value in numbers[row]]
            for other in range(height):
                if other == row or left[other][column].is_zero:
                    continue
                factor, weight = left[other][column], numbers[other][column]
                left[other] = [
                    a - factor * b for a, b in zip(left[other], left[row], strict=True)
                ]
                left[other][column] = program.zero
                numbers[other] = [
                    (a - weight * b) % prime
                    for a, b in zip(numbers[other], numbers[row], strict=True)
                ]
        return cls(program, pivots, left, width)

    def values(
        self, names: Sequence[str], kind: str, minus: Sequence[Scalar] = ()
    ) -> dict[str, Scalar]:
        """Dependent unknowns, by the names of their inputs, where A x = -b."""
        free = [k for k in range(self.width) if k not in self.pivots]
        found = dict[str, Scalar]()
        for column, row in self.pivots.items():
            entries = self.rows[row]
            terms = [
                entries[k] * self.program.input(f"{kind}[{names[k]}]") for k in free
            ]
            terms += [entries[self.width + k] * value for k, value in enumerate(minus)]
            found[f"{kind}[{names[column]}]"] = -sum(terms, self.program.zero)
        return found


def _residues(
    program: Program, rows: Sequence[Sequence[Scalar]]
) -> tuple[np.ndarray, int]:
    """Values of entries at a random point modulo a prime, and the prime."""
    rng = random_generator(DEFAULT_SEED)
    field = PrimeField.random(rng)
    sampler = sampler_of(program, [entry.node for row in rows for entry in row], None)
    geometry = {name: field.draw(rng, (1,)) for name in sampler.symbols}
    values = sampler.evaluate(field, rng, 1, geometry)
    return values.reshape(len(rows), -1), int(field.p)
