"""Random points of a finite field for the inputs of a program, respecting what the inputs mean.

Sines and cosines become leaves: an angle is a point of the unit circle, and angles that are rational multiples of one
another (coupled joints) are multiples of one circle point, so their algebraic relation holds exactly.  A constant angle
other than zero is a point that all samples share.  Quaternions are points of the unit sphere.  An input used both as an
angle and as a number (the turn of a screw) gets two independent values, because x, sin x and cos x satisfy no
polynomial relation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import reduce
from math import lcm

import numpy as np

from echelon.exact.field import PrimeField, Residues
from echelon.exact.numbers import Surd
from echelon.program.operations import Op
from echelon.program.schedule import ModularArithmetic, Schedule
from echelon.program.tape import Program


class FieldSampler:
    """Evaluates outputs of a program at random points of a prime field.

    Parameters
    ----------
    program : Program
    outputs : sequence of int
        Output nodes.
    """

    def __init__(self, program: Program, outputs: Sequence[int]) -> None:
        self.program = program
        needed = program.needed(outputs)
        trigonometric = [n for n in needed if program.ops[n] in (Op.SIN, Op.COS)]
        self._schedule = Schedule(program, outputs, trigonometric)
        leaves = set(self._schedule.leaves)
        self._trigonometric = [n for n in trigonometric if n in leaves]
        self._angles = self._sort_angles({program.lhs[n] for n in self._trigonometric})
        self.symbols = sorted(program.inputs[n].name for n in needed if self._is_symbol(n))

    @property
    def largest_turn(self) -> int:
        """Degree of the sines and cosines in their independent circle points: multiples of angles, added up."""
        return max((sum(map(abs, form.values())) for form in self._angles.values()), default=1)

    def _is_symbol(self, node: int) -> bool:
        return node in self.program.inputs and self.program.inputs[node].role == "symbol"

    def _sort_angles(self, arguments: set[int]) -> dict[int, dict[int, int]]:
        """For every argument of a sine or cosine, how many times each independent angle is in it."""
        forms = {argument: _linear_form(self.program, argument) for argument in sorted(arguments)}
        units: dict[int, int] = {}
        for form in forms.values():
            for atom, ratio in form.items():
                units[atom] = lcm(units.get(atom, 1), ratio.denominator)
        return {argument: {k: int(ratio * units[k]) for k, ratio in form.items()} for argument, form in forms.items()}

    def evaluate(
        self, field: PrimeField, rng: np.random.Generator, states: int, geometry: Mapping[str, Residues]
    ) -> Residues:
        """Evaluate at random states for given geometries.

        Parameters
        ----------
        field : PrimeField
        rng : numpy Generator
        states : int
            Random states per geometry.
        geometry : mapping of str to array of shape (geometries,)
            Value of every symbol; for an angle symbol the tangent of half the angle.

        Returns
        -------
        array of shape (outputs, geometries, states)

        Raises
        ------
        DegenerateSampleError
            If a denominator vanishes at a point.
        """
        geometries = len(next(iter(geometry.values()))) if geometry else 1
        samples = geometries * states
        spread = {name: np.repeat(value, states) for name, value in geometry.items()}
        values = self._draw_inputs(field, rng, samples, spread)
        values.update(self._draw_angles(field, rng, samples, spread))
        result = self._schedule.run(ModularArithmetic(field), values, samples)
        return result.reshape(len(result), geometries, states)

    def _draw_inputs(
        self, field: PrimeField, rng: np.random.Generator, samples: int, spread: Mapping[str, Residues]
    ) -> dict[int, Residues]:
        values: dict[int, Residues] = {}
        for node in self._schedule.leaves:
            if self._is_symbol(node):
                values[node] = spread[self.program.inputs[node].name]
            elif node in self.program.inputs:
                values[node] = field.draw(rng, (samples,))
        for group in self.program.unit_groups:
            if any(node in values for node in group):
                points = field.sphere(field.draw(rng, (len(group) - 1, samples)))
                values.update(zip(group, points, strict=True))
        return values

    def _draw_angles(
        self, field: PrimeField, rng: np.random.Generator, samples: int, spread: Mapping[str, Residues]
    ) -> dict[int, Residues]:
        points = {argument: self._identity(field, samples) for argument in self._angles}
        atoms = list(dict.fromkeys(atom for form in self._angles.values() for atom in form))
        if atoms:
            tangents = np.stack([self._tangent(atom, field, rng, samples, spread) for atom in atoms])
            cosines, sines = field.circle(tangents)
            circle = {atom: (cosines[i], sines[i]) for i, atom in enumerate(atoms)}
        for argument, form in self._angles.items():
            turns = [circle[k] if n == 1 else field.multiply_angle(circle[k], n) for k, n in form.items()]
            if turns:
                points[argument] = reduce(field.add_angles, turns)
        ops, lhs = self.program.ops, self.program.lhs
        return {node: points[lhs[node]][0 if ops[node] == Op.COS else 1] for node in self._trigonometric}

    def _identity(self, field: PrimeField, samples: int) -> tuple[Residues, Residues]:
        return np.ones(samples, dtype=field.dtype), np.zeros(samples, dtype=field.dtype)

    def _tangent(
        self,
        atom: int,
        field: PrimeField,
        rng: np.random.Generator,
        samples: int,
        spread: Mapping[str, Residues],
    ) -> Residues:
        if self._is_symbol(atom):
            return spread[self.program.inputs[atom].name]
        varies = any(n in self.program.inputs and not self._is_symbol(n) for n in self.program.needed([atom]))
        return field.draw(rng, (samples,)) if varies else np.repeat(field.draw(rng, (1,)), samples)


def _linear_form(program: Program, node: int) -> dict[int, Fraction]:
    """A node as a rational combination of atoms: inputs, the constant 1, and nodes that are not linear in others."""
    op, a, b = program.ops[node], program.lhs[node], program.rhs[node]
    if op == Op.CONSTANT and not isinstance(value := program.constants[node], Surd):
        return {program.one.node: Fraction(value)} if value else {}
    if op == Op.NEG:
        return _combined({}, _linear_form(program, a), Fraction(-1))
    if op in (Op.ADD, Op.SUB):
        sign = Fraction(1 if op == Op.ADD else -1)
        return _combined(_linear_form(program, a), _linear_form(program, b), sign)
    if op == Op.MUL:
        for factor, other in ((a, b), (b, a)):
            ratio = program.constants.get(factor)
            if ratio is not None and not isinstance(ratio, Surd):
                return _combined({}, _linear_form(program, other), Fraction(ratio))
    return {node: Fraction(1)}


def _combined(left: dict[int, Fraction], right: dict[int, Fraction], factor: Fraction) -> dict[int, Fraction]:
    """The form left + factor · right, without zeros."""
    total = {k: left.get(k, Fraction(0)) + factor * right.get(k, Fraction(0)) for k in {**left, **right}}
    return {k: v for k, v in total.items() if v}
