"""Random points of a finite field for programs with any functions, respecting the relations among these.

Functions become leaves whose values satisfy exactly the algebraic relations that hold for all real inputs (see
:mod:`echelon.program.canonical`): an angle is a point of the unit circle, angles that are rational multiples of one
another are multiples of one circle point, exp(x + y) is a product, and so on.  Signs are those of a random real point
for every sample.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from math import prod
from operator import mul

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import UnknownRelationsError
from echelon.exact.field import DEFAULT_SEED, PrimeField, Residues, random_generator, rank
from echelon.exact.polynomial import Rational
from echelon.program.canonical import CanonicalForms, Form, Product, Signs, Turn
from echelon.program.derivatives import derivatives
from echelon.program.generators import ConstantName, GeneratorValues, constant_names, generators_of, residues_of
from echelon.program.operations import Op
from echelon.program.region import RealPoints
from echelon.program.rewriting import WRITTEN_OUT, written_out
from echelon.program.schedule import FieldSampler, ModularArithmetic, Size, polynomial_size
from echelon.program.tape import Program, Scalar

_Pattern = tuple[Signs, npt.NDArray[np.intp]]  # signs, and the samples that have them


class FunctionSampler(FieldSampler):
    """Evaluates outputs of a program with any functions at random points of a prime field."""

    def __init__(
        self, program: Program, outputs: Sequence[int], values: Mapping[str, Rational | float] | None = None
    ) -> None:
        if not WRITTEN_OUT.isdisjoint(program.ops):
            program, outputs = written_out(program, outputs)
        super().__init__(program, outputs)
        ops, needed = self.program.ops, self.program.needed(outputs)
        leaves = self._functions
        self._arcs = [n for n in leaves if ops[n] == Op.ATAN and self._varies(n)]
        self._functions = [n for n in leaves if ops[n] != Op.SIGN and n not in self._arcs]
        self._sign_leaves = [n for n in leaves if ops[n] == Op.SIGN]
        self._plain = {self.program.inputs[n].name for n in needed if self._is_symbol(n)}
        self.canonical = CanonicalForms(self.program)
        has_regions = any(ops[n] in (Op.SIGN, Op.SQRT, Op.LOG) for n in needed)
        self._region = RealPoints(self.program, outputs, values) if has_regions else None
        if self._region is None:
            self.canonical.forms([(n, ()) for n in self._functions])
        if self._arcs:
            self._check_arcs(values)

    @property
    def regions(self) -> int:
        """Number of regions into which signs and domains cut the real points; this many states visit them all."""
        return self._region.count if self._region is not None else 1

    @property
    def signs(self) -> tuple[int, str]:
        """Number of regions of signs that are visited, 0 without signs, and what is known of others."""
        if self._region is None or not self._region.has_signs:
            return 0, ""
        return self._region.count, str(self._region.report)

    @property
    def unseen_regions(self) -> str:
        """Words about regions of signs that may add something and were not visited; empty if there are none."""
        if self._region is None or not self._region.has_signs:
            return ""
        return self._region.report.unseen

    @property
    def sign_constants(self) -> list[str]:
        """Constants that signs depend on, so that regions are those of one value of each."""
        return self._region.constants if self._region is not None and self._region.has_signs else []

    def real_states(self, rng: np.random.Generator, states: int) -> dict[str, Floats]:
        """Real values of inputs by name, at states of all regions in turn; empty where any values will do."""
        if self._region is None:
            return {}
        inputs = self.program.inputs
        drawn = self._region.draw(rng, states)
        return {inputs[node].name: values for node, values in drawn.items() if node in inputs}

    @property
    def symbols(self) -> list[str]:
        """Constants that the outputs depend on, sorted; functions of constants join when first evaluated."""
        names = self._constants().values()
        derived = {c.definition: c.name for c in names if c.name != c.definition}
        rooted = {self.program.inputs[n].name for n in self.canonical.rooted}
        return sorted((self._plain - rooted) | set(derived.values()))

    @property
    def definitions(self) -> dict[str, str]:
        """What the symbols that are functions of constants stand for, as expressions in constants."""
        return {c.name: c.definition for c in self._constants().values() if c.name != c.definition}

    @property
    def angles(self) -> frozenset[str]:
        """Symbols whose values stand for the tangent of half of them."""
        return frozenset(c.name for c in self._constants().values() if c.is_angle)

    def _constants(self) -> dict[str, ConstantName]:
        canonical = self.canonical
        numeric = {f"x{n}" for n in self._inputs}
        numeric |= {g for form in canonical.known for g in generators_of(form)}
        numeric |= {g for r in canonical.generators.values() if r.kind == "root" for g in r.element.symbols()}
        return constant_names(canonical, numeric)

    @property
    def leaf_size(self) -> Size:
        """Bound on a leaf as a quotient of polynomials in the independent random numbers, e.g. multiples of angles."""
        # a cosine or sine of n angles is a quotient of degree 2n, with coefficients that add up to 4ⁿ at most; a unit
        # quaternion is one of degree 2
        canonical = self.canonical
        # only about half of all points have a root that is needed, so twice as many of them may be false
        roots = prod(2 * canonical.unit(g.name) for g in canonical.generators.values() if g.kind == "root")
        powers = max((canonical.unit(f"x{node}") for node in canonical.rooted), default=1)
        sizes = [_size(form) for form in canonical.known]
        degree = max([2, powers, *(size.degree for size in sizes)])
        return Size(degree * roots, max([2.0, *(size.bits for size in sizes)]) * roots)

    def _varies(self, node: int) -> bool:
        """Whether a node depends on the state."""
        inputs = self.program.inputs
        return any(n in inputs and inputs[n].role == "state" for n in self.program.needed([node]))

    def _check_arcs(self, values: Mapping[str, Rational | float] | None) -> None:
        """Refuse arc tangents that depend on one another or on angles."""
        program = self.program
        circular = [n for n in program.needed(self.outputs) if program.ops[n] in (Op.SIN, Op.COS)]
        angles = [program.lhs[n] for n in circular if self._varies(n)]
        nodes = list(dict.fromkeys([*self._arcs, *angles]))
        inputs = [n for n in program.needed(nodes) if n in program.inputs and not self._is_symbol(n)]
        recorded = derivatives(program, nodes, inputs)
        slopes = [recorded.get((i, k), program.zero.node) for i in range(len(nodes)) for k in range(len(inputs))]
        together = reduce(mul, (Scalar(program, n) for n in recorded.values()))  # so that all signs occur together
        sampler, rng = FunctionSampler(program, [*slopes, together.node], values), random_generator(DEFAULT_SEED)
        field = PrimeField.random(rng)
        geometry = {name: field.draw(rng, (1,)) for name in sampler.symbols}
        table = sampler.evaluate(field, rng, sampler.regions * (len(nodes) + 1), geometry)[:-1, 0]
        sampled = table.reshape(len(nodes), len(inputs), -1)
        _check_independent(sampled, len(self._arcs), sampler.regions, field)

    def evaluate(
        self, field: PrimeField, rng: np.random.Generator, states: int, geometry: Mapping[str, Residues]
    ) -> Residues:
        """Evaluate at random states for given geometries."""
        # shapes: geometry (geometries,); returns (outputs, geometries, states)
        geometries = len(next(iter(geometry.values()))) if geometry else 1
        samples = geometries * states
        reals = self._region.draw(rng, states) if self._region is not None else {}
        reals = {node: np.tile(value, geometries) for node, value in reals.items()}
        patterns = self._patterns(reals, samples)
        spread = {name: np.repeat(value, states) for name, value in geometry.items()}
        forms = [self.canonical.form(node, signs) for node, regions in patterns.items() for signs, _ in regions]
        wanted = {g for form in forms for g in generators_of(form)}
        drawn = GeneratorValues(self.canonical, field, rng, spread, reals, samples, self._constants())
        generators = drawn.draw(wanted, self._inputs)
        values = {n: drawn.inputs[n] for n in self._inputs}
        for node in self._sign_leaves:
            values[node] = _embedded(np.sign(reals[self.program.lhs[node]]), field)
        values |= {n: field.draw(rng, (samples,)) for n in self._arcs}
        circles = self._circles(generators, field)
        for node, regions in patterns.items():
            values[node] = self._combined(node, regions, generators, circles, field, samples)
        result = self._schedule.run(ModularArithmetic(field), values, samples)
        return result.reshape(len(result), geometries, states)

    # -- signs and forms -----------------------------------------------------------------------------------------

    def _patterns(self, reals: Mapping[int, npt.NDArray[np.float64]], samples: int) -> dict[int, list[_Pattern]]:
        """For every function, the signs that occur in it and the samples where they do; all their forms are known."""
        everywhere = np.arange(samples)
        while True:
            rooted = len(self.canonical.rooted)
            found: dict[int, list[_Pattern]] = {}
            for node in self._functions:
                signed = self.canonical.signed(node) if self._region is not None else []
                found[node] = _sorted_signs(signed, reals) if signed else [((), everywhere)]
            self.canonical.forms([(node, signs) for node, regions in found.items() for signs, _ in regions])
            if len(self.canonical.rooted) == rooted:
                return found

    # -- values ---------------------------------------------------------------------------------------------------

    def _circles(self, generators: Mapping[str, Residues], field: PrimeField) -> dict[str, tuple[Residues, Residues]]:
        angles = [name for name in generators if self.canonical.generators[name].kind == "angle"]
        if not angles:
            return {}
        cosines, sines = field.circle(np.stack([generators[name] for name in angles]))
        return {name: (cosines[i], sines[i]) for i, name in enumerate(angles)}

    def _combined(
        self,
        node: int,
        regions: Sequence[_Pattern],
        generators: Mapping[str, Residues],
        circles: Mapping[str, tuple[Residues, Residues]],
        field: PrimeField,
        samples: int,
    ) -> Residues:
        """Values of a function, region by region."""
        total = np.zeros(samples, dtype=field.dtype)
        for signs, where in regions:
            form = self.canonical.form(node, signs)
            if isinstance(form, Turn):
                turns = [(tuple(x[where] for x in circles[g]), n) for g, n in form.multiples.items()]
                points = [(c, s) if n == 1 else field.multiply_angle((c, s), n) for (c, s), n in turns]
                zero = np.ones(len(where), dtype=field.dtype), np.zeros(len(where), dtype=field.dtype)
                point = reduce(field.add_angles, points, zero)
                total[where] = point[0 if self.program.ops[node] == Op.COS else 1]
            else:
                own = {g: generators[g][where] for g in generators_of(form)}
                total[where] = residues_of(form, own, field, len(where))
        return total


def _check_independent(slopes: Residues, arcs: int, regions: int, field: PrimeField) -> None:
    """Check arc tangents by the derivatives of them and of arguments of sines and cosines."""
    # 2i·atan w is a logarithm of (1 + i·w)/(1 − i·w).  By Ax's theorem (see echelon.program.canonical) arc tangents are
    # algebraically independent of one another and of the other functions, unless a rational combination of them and of
    # arguments of sines and cosines is constant in a region.  Then the same combination of their derivatives vanishes.
    # So arc tangents whose derivatives are linearly independent of these stand for random elements of a field; whether
    # they are is decided exactly, region by region.  Where they are not, the combination is constant, but that constant
    # is not looked for: such relations count as unknown
    # shapes: slopes (functions, inputs, states)
    for region in range(regions):
        table = slopes[:, :, region::regions].reshape(len(slopes), -1).T
        angles = rank(table[:, arcs:], field) if arcs < len(slopes) else 0
        if rank(table, field) < arcs + angles:
            raise UnknownRelationsError("arc tangents that differ by a constant, or from an angle, in some region")


def _sorted_signs(nodes: Sequence[int], reals: Mapping[int, npt.NDArray[np.float64]]) -> list[_Pattern]:
    """The different signs of some nodes, with the samples where they occur."""
    table = np.sign(np.stack([reals[n] for n in nodes], axis=1)).astype(int)
    rows, which = np.unique(table, axis=0, return_inverse=True)
    which = which.reshape(-1)
    return [(tuple(zip(nodes, map(int, row), strict=True)), np.flatnonzero(which == k)) for k, row in enumerate(rows)]


def _size(form: Form) -> Size:
    if isinstance(form, Turn):
        turns = sum(map(abs, form.multiples.values()))
        return Size(2 * turns, 2.0 * turns)
    if isinstance(form, Product):
        return Size(sum(map(abs, form.exponents.values())), 0.0)
    parts = [polynomial_size([part]) for part in (form.numerator, form.denominator)]
    return Size(sum(part.degree for part in parts), sum(part.bits for part in parts))


def _embedded(signs: npt.NDArray[np.float64], field: PrimeField) -> Residues:
    result = np.empty(len(signs), dtype=field.dtype)
    result[:] = [int(s) % field.p for s in signs]
    return result
