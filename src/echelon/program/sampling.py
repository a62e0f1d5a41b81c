"""Random points of a finite field for the inputs of a program, respecting what the inputs mean.

Functions become leaves whose values satisfy exactly the algebraic relations that hold for all real inputs (see
:mod:`echelon.program.canonical`): an angle is a point of the unit circle, angles that are rational multiples of one
another are multiples of one circle point, exp(x + y) is a product, and so on.  Quaternions are points of the unit
sphere.  Signs are those of a random real point for every sample.

Independent generators are drawn freely, but for the roots of sums, r^N = |f|: |f| must be a square for even N.  Because
−1 is not a square modulo our primes, exactly one of f and −f is; samples where it is not |f| are drawn again.

What is constant for the model is the same at all samples.  Constants have names such as ``a``, ``exp[a/2]``,
``log[2]``, ``root2[a]``.  Coefficients of B may depend on them like on any other constant, so they are symbols to
everyone else.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from math import prod
from operator import mul

import numpy as np
import numpy.typing as npt

from echelon.errors import DegenerateSampleError, UnknownRelationsError
from echelon.exact.field import DEFAULT_SEED, PrimeField, Residues, random_generator, rank
from echelon.exact.polynomial import Polynomial, Rational, format_polynomial, repeated
from echelon.exact.rational import RationalFunction
from echelon.program.canonical import CanonicalForms, Form, Generator, Product, Signs, Turn
from echelon.program.derivatives import derivatives
from echelon.program.region import RealPoints, RegionReport
from echelon.program.rewriting import WRITTEN_OUT, written_out
from echelon.program.schedule import ModularArithmetic, Schedule, Size, polynomial_size
from echelon.program.tape import Op, Program, Scalar


@dataclass(frozen=True)
class ConstantName:
    """A generator that is a constant of the model."""

    name: str  # without parentheses, so that it is a symbol and not the cosine of one
    # an expression in the model's constants (see :mod:`echelon.program.text`); equal to the name for a plain one
    definition: str
    is_angle: bool = False  # whether values stand for the tangent of half of the constant


def constant_names(canonical: CanonicalForms, numeric: Collection[str]) -> dict[str, ConstantName]:
    """Names of all generators known so far that are constants, by generator."""
    names: dict[str, ConstantName] = {}
    for generator in canonical.generators.values():
        if not generator.constant or generator.kind == "root":
            continue
        if all(g in names for g in generator.element.symbols()):
            names[generator.name] = _named(canonical, generator, numeric, names)
    return names


def _named(
    canonical: CanonicalForms, generator: Generator, numeric: Collection[str], names: dict[str, ConstantName]
) -> ConstantName:
    unit = canonical.unit(generator.name)
    if generator.kind == "input":
        plain = canonical.program.inputs[generator.node].name
        return ConstantName(plain, plain) if unit == 1 else ConstantName(f"root{unit}[{plain}]", f"{plain}^(1/{unit})")
    inner = generator.element.symbols()
    is_input = len(inner) == 1 and generator.element == Polynomial.generator(inner[0])
    if generator.kind == "angle" and unit == 1 and is_input and canonical.generators[inner[0]].kind == "input":
        plain = names[inner[0]].definition
        if inner[0] not in numeric:
            return ConstantName(plain, plain, is_angle=True)
    share = 2 * unit if generator.kind == "angle" else unit
    element = generator.element * RationalFunction(Polynomial.constant(1), share)
    function = "tan" if generator.kind == "angle" else generator.kind
    shown = _renamed(element, {g: names[g].name for g in inner})
    definition = _renamed(element, {g: _grouped(names[g].definition, " *^/") for g in inner})
    bare = f"abs({definition})" if function == "log" and " " in definition else definition
    return ConstantName(f"{function}[{shown}]", f"{function}({bare})")


def _renamed(element: RationalFunction, names: dict[str, str]) -> str:
    """An element as text, with its generators called by name."""
    top = format_polynomial(element.numerator, names)
    if element.is_polynomial:
        return top
    return f"{_grouped(top, ' ')}/{_grouped(format_polynomial(element.denominator, names), ' */')}"


def _grouped(text: str, separators: str) -> str:
    """Text in parentheses if one of some characters is in it."""
    return f"({text})" if any(c in text for c in separators) else text


_ROUNDS = 400


class GeneratorValues:
    """One drawing of the generators."""

    def __init__(
        self,
        canonical: CanonicalForms,
        field: PrimeField,
        rng: np.random.Generator,
        symbols: Mapping[str, Residues],
        reals: Mapping[int, npt.NDArray[np.float64]],
        samples: int,
        names: Mapping[str, ConstantName],
    ) -> None:
        self._names = names
        self.canonical, self.field, self.rng = canonical, field, rng
        self.symbols, self.reals, self.samples = symbols, reals, samples
        self.inputs: dict[int, Residues] = {}
        self._values: dict[str, Residues] = {}

    def draw(self, wanted: set[str], inputs: Sequence[int]) -> dict[str, Residues]:
        """Values of some generators and all that they depend on; also fills :attr:`inputs`."""
        names = self._with_ancestors(wanted | {self._input_generator(node) for node in inputs})
        everywhere = np.arange(self.samples)
        for name in names:
            self._values[name] = np.zeros(self.samples, dtype=self.field.dtype)
        pending = everywhere
        for attempt in range(_ROUNDS):
            for name in names:
                self._fill(self.canonical.generators[name], pending, first=attempt == 0)
            self._fill_spheres(pending)
            pending = self._fill_roots(names, pending)
            if not len(pending):
                break
        else:
            raise UnknownRelationsError("too many roots of sums at once: no point of the field has all of them")
        self._fill_inputs(inputs)
        return self._values

    def _input_generator(self, node: int) -> str:
        return self.canonical.input_generator(node).name

    def _with_ancestors(self, wanted: set[str]) -> list[str]:
        """In order of definition; only roots need what they are made of."""
        generators, pending, found = self.canonical.generators, list(wanted), set(wanted)
        while pending:
            generator = generators[pending.pop()]
            if generator.kind == "root":
                new = set(generator.element.symbols()) - found
                found |= new
                pending += new
        return [name for name in generators if name in found]

    # -- free generators -----------------------------------------------------------------------------------------

    def _fill(self, generator: Generator, where: npt.NDArray[np.intp], *, first: bool) -> None:
        if generator.kind == "root" or (generator.constant and not first):
            return
        symbol = self._symbol(generator)
        if symbol is not None:
            self._values[generator.name][where] = symbol[where]
        elif generator.constant:
            self._values[generator.name][where] = self.field.draw(self.rng, (1,))
        else:
            self._values[generator.name][where] = self.field.draw(self.rng, (len(where),))

    def _symbol(self, generator: Generator) -> Residues | None:
        """The given value of a constant of the model, or of a function of constants."""
        if not generator.constant:
            return None
        if generator.name in self._names and self._names[generator.name].name in self.symbols:
            return self.symbols[self._names[generator.name].name]
        # the caller may not know yet that a constant is under a root: then the value stands for the root
        return self.symbols[self.canonical.program.inputs[generator.node].name] if generator.kind == "input" else None

    def _fill_spheres(self, where: npt.NDArray[np.intp]) -> None:
        for group in self.canonical.program.unit_groups:
            names = [self._input_generator(node) for node in group]
            present = [name in self._values for name in names]
            if not any(present):
                continue
            if self.canonical.rooted & set(group):
                raise UnknownRelationsError("a root of a component of a quaternion")
            points = self.field.sphere(self.field.draw(self.rng, (len(group) - 1, len(where))))
            for name, point in zip(names, points, strict=True):
                if name in self._values:
                    self._values[name][where] = point

    def _fill_inputs(self, inputs: Sequence[int]) -> None:
        for node in inputs:
            name = self._input_generator(node)
            value = self._values[name]
            if node in self.canonical.rooted:
                value = _power(value, self.canonical.unit(name), self.field)
                value = np.where(self.reals[node] < 0, -value % self.field.p, value)
            self.inputs[node] = value

    # -- roots ---------------------------------------------------------------------------------------------------

    def _fill_roots(self, names: Sequence[str], where: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
        """Fill roots at some samples; returns those where one does not exist."""
        missing = np.zeros(len(where), dtype=bool)
        for name in names:
            generator = self.canonical.generators[name]
            if generator.kind != "root":
                continue
            own = {g: self._values[g][where] for g in generator.element.symbols()}
            size = residues_of(generator.element, own, self.field, len(where))
            negative = self._real(generator)[where] < 0
            size = np.where(negative, -size % self.field.p, size)
            root, exists = _root(size, self.canonical.unit(name), self.field)
            if generator.constant and not exists.all():
                raise DegenerateSampleError(f"a constant has no root modulo {self.field.p}")
            self._values[name][where] = root
            missing |= ~exists
        return where[missing]

    def _real(self, generator: Generator) -> npt.NDArray[np.float64]:
        """The real value of what a generator is made of, at the real points of all samples."""
        values = {g: self._real_generator(self.canonical.generators[g]) for g in generator.element.symbols()}
        with np.errstate(all="ignore"):
            result = generator.element.evaluate(values, lambda x: np.asarray(float(x)))
        return np.broadcast_to(np.asarray(result, dtype=np.float64), (self.samples,))

    def _real_generator(self, generator: Generator) -> npt.NDArray[np.float64]:
        unit = self.canonical.unit(generator.name)
        if generator.kind == "input":
            value = self.reals[generator.node]
            return np.abs(value) ** (1 / unit) if generator.node in self.canonical.rooted else value
        inner = self._real(generator)
        with np.errstate(all="ignore"):
            if generator.kind == "exp":
                return np.exp(inner / unit)
            if generator.kind == "angle":
                return np.tan(inner / (2 * unit))
            size = np.abs(inner)
            return np.log(size) if generator.kind == "log" else size ** (1 / unit)


def residues_of(
    form: RationalFunction | Product, values: Mapping[str, Residues], field: PrimeField, samples: int
) -> Residues:
    """A quotient of polynomials, or a product of powers, of generators."""
    if isinstance(form, Product):
        total = np.ones(samples, dtype=field.dtype)
        for name, exponent in form.exponents.items():
            base = values[name] if exponent > 0 else field.invert_array(values[name])
            total = total * _power(base, abs(exponent), field) % field.p
        return total
    top = _polynomial(form.numerator, values, field, samples)
    if form.is_polynomial:
        return top
    return top * field.invert_array(_polynomial(form.denominator, values, field, samples)) % field.p


def _polynomial(polynomial: Polynomial, values: Mapping[str, Residues], field: PrimeField, samples: int) -> Residues:
    total = np.zeros(samples, dtype=field.dtype)
    for monomial, coefficient in polynomial.sorted_terms():
        term = np.full(samples, field.embed(coefficient), dtype=field.dtype)
        for name, exponent in monomial:
            term = term * _power(values[name], exponent, field) % field.p
        total = (total + term) % field.p
    return total


def _power(base: Residues, exponent: int, field: PrimeField) -> Residues:
    return repeated(base, exponent, np.ones_like(base), lambda a, b: a * b % field.p)


def _root(x: Residues, degree: int, field: PrimeField) -> tuple[Residues, npt.NDArray[np.bool_]]:
    """The root of this degree, which for an even degree is itself a square, and where it exists."""
    order = field.p - 1 if degree % 2 else (field.p - 1) // 2
    try:
        exponent = pow(degree, -1, order)
    except ValueError:
        raise DegenerateSampleError(f"roots of degree {degree} are not unique modulo {field.p}") from None
    root = _power(x, exponent, field)
    exists: npt.NDArray[np.bool_] = np.asarray(_power(root, degree, field) == x, dtype=bool)
    return root, exists


_Pattern = tuple[Signs, npt.NDArray[np.intp]]  # signs, and the samples that have them


class FieldSampler:
    """Evaluates outputs of a program at random points of a prime field."""

    def __init__(
        self, program: Program, outputs: Sequence[int], values: Mapping[str, Rational | float] | None = None
    ) -> None:
        if not WRITTEN_OUT.isdisjoint(program.ops):
            program, outputs = written_out(program, outputs)
        self.program, self.outputs = program, outputs
        ops = self.program.ops
        needed = self.program.needed(outputs)
        functions = [n for n in needed if ops[n] >= Op.SIN]
        self._schedule = Schedule(self.program, outputs, functions)
        leaves = set(self._schedule.leaves)
        self._arcs = [n for n in functions if n in leaves and ops[n] == Op.ATAN and self._varies(n)]
        self._functions = [n for n in functions if n in leaves and ops[n] != Op.SIGN and n not in self._arcs]
        self._sign_leaves = [n for n in functions if n in leaves and ops[n] == Op.SIGN]
        self._plain = {self.program.inputs[n].name for n in needed if self._is_symbol(n)}
        self.canonical = CanonicalForms(self.program)
        has_regions = any(ops[n] in (Op.SIGN, Op.SQRT, Op.LOG) for n in functions)
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
    def region_report(self) -> RegionReport | None:
        """Which regions are visited, where there are signs."""
        return self._region.report if self._region is not None and self._region.has_signs else None

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
        numeric = {f"x{n}" for n in self._schedule.leaves if n in self.program.inputs}
        numeric |= {g for form in canonical.known for g in generators_of(form)}
        numeric |= {g for r in canonical.generators.values() if r.kind == "root" for g in r.element.symbols()}
        return constant_names(canonical, numeric)

    @property
    def leaves(self) -> int:
        """Number of inputs and functions that the outputs are computed from."""
        return len(self._schedule.leaves)

    @property
    def leaf_size(self) -> Size:
        """Bound on a leaf as a quotient of polynomials in the independent random numbers, e.g. multiples of angles.

        A cosine or sine of n angles is a quotient of degree 2n, with coefficients that add up to 4ⁿ at most; a unit
        quaternion is one of degree 2.
        """
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
        sampler, rng = FieldSampler(program, [*slopes, together.node], values), random_generator(DEFAULT_SEED)
        field = PrimeField.random(rng)
        geometry = {name: field.draw(rng, (1,)) for name in sampler.symbols}
        table = sampler.evaluate(field, rng, sampler.regions * (len(nodes) + 1), geometry)[:-1, 0]
        sampled = table.reshape(len(nodes), len(inputs), -1)
        _check_independent(sampled, len(self._arcs), sampler.regions, field)

    def _is_symbol(self, node: int) -> bool:
        return node in self.program.inputs and self.program.inputs[node].role == "symbol"

    def with_order(self, order: int | None) -> FieldSampler:  # noqa: ARG002
        """The sampler itself: without loops there are no curves that have an order."""
        return self

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
        wanted = {g for node in patterns for signs, _ in patterns[node] for g in generators_of(self._form(node, signs))}
        inputs = [n for n in self._schedule.leaves if n in self.program.inputs]
        drawn = GeneratorValues(self.canonical, field, rng, spread, reals, samples, self._constants())
        generators = drawn.draw(wanted, inputs)
        values = {n: drawn.inputs[n] for n in inputs}
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

    def _form(self, node: int, signs: Signs) -> Form:
        return self.canonical.form(node, signs)

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
            form = self._form(node, signs)
            if isinstance(form, Turn):
                turns = [(tuple(x[where] for x in circles[g]), n) for g, n in form.multiples.items()]
                points = [(c, s) if n == 1 else field.multiply_angle((c, s), n) for (c, s), n in turns]
                point = reduce(field.add_angles, points) if points else _identity(field, len(where))
                total[where] = point[0 if self.program.ops[node] == Op.COS else 1]
            else:
                own = {g: generators[g][where] for g in generators_of(form)}
                total[where] = residues_of(form, own, field, len(where))
        return total


def _check_independent(slopes: Residues, arcs: int, regions: int, field: PrimeField) -> None:
    """Check arc tangents by the derivatives of them and of arguments of sines and cosines.

    2i·atan w is a logarithm of (1 + i·w)/(1 − i·w).  By Ax's theorem (see :mod:`echelon.program.canonical`) arc
    tangents are algebraically independent of one another and of the other functions, unless a rational combination of
    them and of arguments of sines and cosines is constant in a region.  Then the same combination of their derivatives
    vanishes.  So arc tangents whose derivatives are linearly independent of these stand for random elements of a field;
    whether they are is decided exactly, region by region.  Where they are not, the combination is constant, but that
    constant is not looked for: such relations count as unknown.
    """
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


def generators_of(form: Form) -> set[str]:
    """All generators that occur in a form."""
    if isinstance(form, Turn):
        return set(form.multiples)
    return set(form.exponents) if isinstance(form, Product) else set(form.symbols())


def _size(form: Form) -> Size:
    if isinstance(form, Turn):
        turns = sum(map(abs, form.multiples.values()))
        return Size(2 * turns, 2.0 * turns)
    if isinstance(form, Product):
        return Size(sum(map(abs, form.exponents.values())), 0.0)
    parts = [polynomial_size([part]) for part in (form.numerator, form.denominator)]
    return Size(sum(part.degree for part in parts), sum(part.bits for part in parts))


def _identity(field: PrimeField, samples: int) -> tuple[Residues, Residues]:
    return np.ones(samples, dtype=field.dtype), np.zeros(samples, dtype=field.dtype)


def _embedded(signs: npt.NDArray[np.float64], field: PrimeField) -> Residues:
    result = np.empty(len(signs), dtype=field.dtype)
    result[:] = [int(s) % field.p for s in signs]
    return result
