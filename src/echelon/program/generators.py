"""Values of the independent generators of a program's functions, and names of those that are constants.

Generators are drawn freely, but for the roots of sums, r^N = |f|: |f| must be a square for even N.  Because −1 is not a
square modulo our primes, exactly one of f and −f is; samples where it is not |f| are drawn again.

What is constant for the model is the same at all samples.  Constants have names such as ``a``, ``exp[a/2]``,
``log[2]``, ``root2[a]``.  Coefficients of B may depend on them like on any other constant, so they are symbols to
everyone else.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.errors import DegenerateSampleError, UnknownRelationsError
from echelon.exact.field import PrimeField, Residues
from echelon.exact.polynomial import Polynomial, format_polynomial, repeated
from echelon.exact.rational import RationalFunction
from echelon.program.canonical import CanonicalForms, Form, Generator, Product, Turn


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


def generators_of(form: Form) -> set[str]:
    """All generators that occur in a form."""
    if isinstance(form, Turn):
        return set(form.multiples)
    return set(form.exponents) if isinstance(form, Product) else set(form.symbols())
