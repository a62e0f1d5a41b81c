"""Random points of a finite field for the inputs of a program, respecting what the inputs mean.

Sines and cosines become leaves: an angle is a point of the unit circle, and angles that are rational multiples of one
another (coupled joints) are multiples of one circle point, so their algebraic relation holds exactly.  Quaternions are
points of the unit sphere.  An input used both as an angle and as a number (the turn of a screw) gets two independent
values, because x, sin x and cos x satisfy no polynomial relation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import lcm

import numpy as np

from echelon.exact.field import PrimeField, Residues
from echelon.exact.numbers import Surd
from echelon.program.schedule import ModularArithmetic, Schedule
from echelon.program.tape import Op, Program

_LARGEST_MULTIPLE = 64
"""Angles whose ratio needs a larger integer than this are drawn independently: monomials of the degree that
regressors have cannot tell the difference."""

_AngleKey = tuple[str, int]


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
        self._angles = self._sort_angles([n for n in trigonometric if n in set(self._schedule.leaves)])
        self.symbols = sorted(program.inputs[n].name for n in needed if self._is_symbol(n))

    def _is_symbol(self, node: int) -> bool:
        return node in self.program.inputs and self.program.inputs[node].role == "symbol"

    def _sort_angles(self, nodes: list[int]) -> dict[int, dict[_AngleKey, Fraction]]:
        """For every sine or cosine, its argument as rational multiples of independent angles."""
        arguments = {n: _linear_form(self.program, self.program.lhs[n]) for n in nodes}
        forms: dict[int, dict[_AngleKey, Fraction]] = {}
        for node, form in arguments.items():
            whole = {("free", self.program.lhs[node]): Fraction(1)}
            forms[node] = whole if form is None else {("input", i): ratio for i, ratio in form.items()}
        units: dict[_AngleKey, int] = {}
        for form in forms.values():
            for key, ratio in form.items():
                units[key] = lcm(units.get(key, 1), ratio.denominator)
        for node, form in forms.items():
            scaled = {key: ratio * units[key] for key, ratio in form.items()}
            large = any(abs(count) > _LARGEST_MULTIPLE for count in scaled.values())
            forms[node] = {("free", self.program.lhs[node]): Fraction(1)} if large else scaled
        return forms

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
        return result.reshape(-1, geometries, states)

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
        keys = list(dict.fromkeys(key for form in self._angles.values() for key in form))
        if not keys:
            return {}
        tangents = np.stack([self._tangent(key, field, rng, samples, spread) for key in keys])
        cosines, sines = field.circle(tangents)
        circle = {key: (cosines[i], sines[i]) for i, key in enumerate(keys)}
        values: dict[int, Residues] = {}
        points: dict[int, tuple[Residues, Residues]] = {}
        for node, form in self._angles.items():
            argument = self.program.lhs[node]
            if argument not in points:
                total = None
                for key, count in form.items():
                    point = field.multiply_angle(circle[key], int(count)) if count != 1 else circle[key]
                    total = point if total is None else field.add_angles(total, point)
                assert total is not None
                points[argument] = total
            values[node] = points[argument][0 if self.program.ops[node] == Op.COS else 1]
        return values

    def _tangent(
        self,
        key: _AngleKey,
        field: PrimeField,
        rng: np.random.Generator,
        samples: int,
        spread: Mapping[str, Residues],
    ) -> Residues:
        kind, node = key
        if kind == "input" and self._is_symbol(node):
            return spread[self.program.inputs[node].name]
        return field.draw(rng, (samples,))


def _linear_form(program: Program, node: int) -> dict[int, Fraction] | None:
    """A node as rational multiples of inputs without a constant, or None if it is anything else."""
    op = program.ops[node]
    if op == Op.INPUT:
        return {node: Fraction(1)}
    if op == Op.NEG:
        return _scale(_linear_form(program, program.lhs[node]), Fraction(-1))
    if op == Op.MUL:
        for constant, other in ((program.rhs[node], program.lhs[node]), (program.lhs[node], program.rhs[node])):
            value = program.constants.get(constant)
            if value is not None and not isinstance(value, Surd):
                return _scale(_linear_form(program, other), Fraction(value))
    if op in (Op.ADD, Op.SUB):
        left, right = _linear_form(program, program.lhs[node]), _linear_form(program, program.rhs[node])
        if left is None or right is None:
            return None
        sign = 1 if op == Op.ADD else -1
        total = {k: left.get(k, Fraction(0)) + sign * right.get(k, Fraction(0)) for k in {**left, **right}}
        return {k: v for k, v in total.items() if v}
    return None


def _scale(form: dict[int, Fraction] | None, factor: Fraction) -> dict[int, Fraction] | None:
    return None if form is None else {k: v * factor for k, v in form.items()}
