"""Functions of a program in terms of independent generators, so that exactly the true algebraic relations hold.

Innermost functions first, every argument is written as a quotient of polynomials in generators.

- Arguments of exponentials and angles are rational combinations of atoms: Laurent monomials, and monomials over a
  common denominator after division with remainder, which are linearly independent over the rationals, also modulo
  constants.  Then their exponentials, and the circle points of those that are angles, are algebraically independent of
  one another and of everything that the atoms are made of (Ax, "On Schanuel's conjectures", Annals of Mathematics 93,
  1971; for the elementary functions: Rosenlicht, "On Liouville's theory of elementary functions", Pacific J. Math. 65,
  1976).
- exp and the circle point of Σ r·m, with atoms m, are products of integer powers of generators exp(m/N) and multiples
  of circle points at m/N, where N is the common denominator of the ratios r of m.
- log Π f^e = Σ e·log|f| over irreducible factors f, because logarithms of coprime polynomials are independent; log exp
  m = m.  Where log|f| stands alone in an exponent, exp(r·log|f|) = |f|^r.
- Roots √Π f^e = Π |f|^(e/2) are algebraic: a generator r with r^N = |f|.  An input x under a root becomes ±r^N itself.

Generators are algebraically independent but for the roots.  Constants that are functions of numbers (log 2, sin 1) are
taken as independent too, as Schanuel's conjecture says.  Signs are constant on regions: every form is for given signs
of the arguments of SIGN and of the inputs under roots.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from math import lcm

import flint

from echelon.errors import InputError, UnknownRelationsError
from echelon.exact.polynomial import Monomial, Number, Polynomial, Surd, parts_of
from echelon.exact.rational import RationalFunction
from echelon.exact.ring import divided, factors, is_rational
from echelon.program.operations import Op
from echelon.program.tape import Program

_ONE = Polynomial.constant(1)
_BASIS: tuple[Number, ...] = (1, Surd((0, 1, 0, 0)), Surd((0, 0, 1, 0)), Surd((0, 0, 0, 1)))


@dataclass(frozen=True)
class Atom:
    """√radicand · Π generator^exponent / divisor."""

    powers: Monomial  # exponents may be negative
    root: int = 0  # 0 to 3 for a factor 1, √2, √3, √6
    divisor: Polynomial = _ONE

    @property
    def generator(self) -> str | None:
        """The generator that this atom is, if it is just one."""
        bare = len(self.powers) == 1 and self.powers[0][1] == 1 and not self.root and self.divisor == _ONE
        return self.powers[0][0] if bare else None

    @property
    def generators(self) -> set[str]:
        """All generators that occur."""
        return {g for g, _ in self.powers} | set(self.divisor.generators())

    @property
    def element(self) -> RationalFunction:
        """The atom as a quotient of polynomials."""
        top = Polynomial({tuple((g, e) for g, e in self.powers if e > 0): _BASIS[self.root]})
        bottom = Polynomial({tuple((g, -e) for g, e in self.powers if e < 0): 1})
        return RationalFunction(top, bottom * self.divisor)


@dataclass
class AtomBasis:
    """The common denominators of all arguments of one kind, growing as arguments are met."""

    is_constant: Callable[[str], bool]  # whether a generator is a constant of the model
    # least common multiples of the denominators' factors that hold constants only, and of the others; monomials become
    # Laurent monomials instead, as long as no other factor occurs
    constant_divisor: Polynomial = _ONE
    divisor: Polynomial = _ONE
    changed: bool = field(default=False)  # set when a denominator grew: then earlier combinations are to be formed anew

    def combination(self, argument: RationalFunction) -> list[tuple[Fraction, Atom]]:
        """The argument as Σ ratio · atom."""
        top, laurent = self._over_common_denominator(argument)
        if self.divisor == _ONE:
            quotient, rest = top, Polynomial({})
        else:
            quotient, rest = self._divided(top, self.divisor)
        parts = [(rest, self.constant_divisor * self.divisor)]
        if self.constant_divisor == _ONE:
            parts.append((quotient, _ONE))
        else:
            whole, fraction = self._divided(quotient, self.constant_divisor)
            parts += [(whole, _ONE), (fraction, self.constant_divisor)]
        return [
            (Fraction(part), Atom(_times(monomial, laurent), k, divisor))
            for polynomial, divisor in parts
            for monomial, coefficient in polynomial.sorted_terms()
            for k, part in enumerate(parts_of(coefficient))
            if part
        ]

    def _over_common_denominator(self, argument: RationalFunction) -> tuple[Polynomial, Monomial]:
        """Numerator over the two divisors, and the Laurent monomial that multiplies it."""
        bottom = argument.denominator
        if bottom == _ONE and self.divisor == _ONE and self.constant_divisor == _ONE:
            return argument.numerator, ()
        if not is_rational(bottom):
            raise UnknownRelationsError("a function of a quotient with square roots of numbers in its denominator")
        content, found = factors(bottom)
        constant, other, laurent = _ONE, _ONE, []
        bare = [(f, e) for f, e in found if len(f.terms) == 1]
        inside = [(f, e) for f, e in found if len(f.terms) > 1]
        for f, e in inside:
            if all(map(self.is_constant, f.generators())):
                constant = constant * f**e
            else:
                other = other * f**e
        for f, e in bare:
            name = f.generators()[0]
            if self.is_constant(name) or (other == _ONE and self.divisor == _ONE):
                laurent.append((name, -e))
            else:
                other = other * f**e
        self.constant_divisor = self._grown(self.constant_divisor, constant)
        self.divisor = self._grown(self.divisor, other)
        top = argument.numerator * (1 / content)
        lift = RationalFunction(self.constant_divisor, constant).numerator
        return top * lift * RationalFunction(self.divisor, other).numerator, tuple(laurent)

    def _grown(self, divisor: Polynomial, needed: Polynomial) -> Polynomial:
        """The least common multiple, up to a number."""
        missing = RationalFunction(needed, divisor).numerator
        if missing.number is not None:
            return divisor
        self.changed = True
        return _product(factors(divisor * missing)[1])

    def _divided(self, top: Polynomial, divisor: Polynomial) -> tuple[Polynomial, Polynomial]:
        names = sorted({*top.generators(), *divisor.generators()})
        order = sorted(names, key=lambda name: (self.is_constant(name), name))
        if not is_rational(top):
            raise UnknownRelationsError("a function of a quotient with square roots of numbers")
        if any(not self.is_constant(g) for g in divisor.generators()):
            self._check_leading(divisor, order)
        return divided(top, divisor, order)

    def _check_leading(self, divisor: Polynomial, order: Sequence[str]) -> None:
        """Remainders are unique modulo constants if the first coefficient, in what varies, is a number."""
        varying = [name for name in order if not self.is_constant(name)]

        def state(monomial: Monomial) -> tuple[int, ...]:
            powers = dict(monomial)
            return tuple(powers.get(name, 0) for name in varying)

        first = max(map(state, divisor.terms))
        leading = [m for m in divisor.terms if state(m) == first]
        if len(leading) > 1 or any(self.is_constant(g) for g, _ in leading[0]):
            raise UnknownRelationsError("a function of a quotient whose leading coefficient holds constants")


def _product(found: Sequence[tuple[Polynomial, int]]) -> Polynomial:
    total = _ONE
    for f, e in found:
        total = total * f**e
    return total


def _times(monomial: Monomial, other: Monomial) -> Monomial:
    powers = dict(monomial)
    for g, e in other:
        powers[g] = powers.get(g, 0) + e
    return tuple(sorted((g, e) for g, e in powers.items() if e))


Signs = tuple[tuple[int, int], ...]  # nodes with their signs, ±1, sorted by node

_LARGEST_UNIT = 10**15  # beyond, exponents of generators would not fit into machine integers
_MOST_PASSES = 200
_MOST_TERMS = 2000
_LARGEST_NESTED_TURN = 24


@dataclass(frozen=True)
class Generator:
    """An independent generator."""

    name: str
    # ``"input"``: the input, or its root if it is under a root.  ``"exp"``: exp(element / unit).  ``"angle"``: the
    # tangent of half of element / unit.  ``"log"``: log|element|.  ``"root"``: |element|^(1 / unit).  ``"atan"``: the
    # arc tangent of a constant
    kind: str
    element: RationalFunction  # in earlier generators
    node: int  # of an input
    constant: bool  # whether it is the same at all samples


@dataclass(frozen=True)
class Product:
    """A product of powers of generators."""

    exponents: Mapping[str, int]


@dataclass(frozen=True)
class Turn:
    """An angle: multiples of the angles of generators, added up."""

    multiples: Mapping[str, int]


Form = Product | Turn | RationalFunction


class CanonicalForms:
    """Forms of the functions of a program."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.generators: dict[str, Generator] = {}
        self.units: dict[str, int] = {}
        self.rooted: set[int] = set()
        self._names: dict[object, str] = {}
        self._bases = {kind: AtomBasis(self._is_constant) for kind in ("exp", "angle")}
        self._changed = False
        self._signs = {n for n, op in enumerate(program.ops) if op == Op.SIGN}
        self._elements: dict[Signs, dict[int, RationalFunction]] = {}
        self._forms: dict[tuple[int, Signs], Form] = {}

    def _is_constant(self, name: str) -> bool:  # no lambda, so that forms can be pickled
        return self.generators[name].constant

    def forms(self, requests: Sequence[tuple[int, Signs]]) -> list[Form]:
        """Forms of function nodes, each for some signs."""
        # units and denominators are shared, so all is formed anew until no request asks for larger ones
        for _ in range(_MOST_PASSES):
            self._changed = False
            found = [self.form(node, signs) for node, signs in requests]
            grown = [basis for basis in self._bases.values() if basis.changed]
            if not self._changed and not grown:
                return found
            for basis in grown:
                basis.changed = False
            self._elements.clear()
            self._forms.clear()
        raise UnknownRelationsError("the arguments of functions have no common unit")

    @property
    def known(self) -> list[Form]:
        """All forms found so far."""
        return list(self._forms.values())

    def signed(self, node: int) -> list[int]:
        """The nodes whose signs the form of a function depends on."""
        ops, lhs = self.program.ops, self.program.lhs
        cone = self.program.needed([lhs[node]], self._signs)
        return sorted({lhs[n] for n in cone if ops[n] == Op.SIGN} | (self.rooted & set(cone)))

    def input_generator(self, node: int) -> Generator:
        """The generator of an input."""
        name = f"x{node}"
        if name not in self.generators:
            constant = self.program.inputs[node].role == "symbol"
            self.generators[name] = Generator(name, "input", RationalFunction(0), node, constant)
        return self.generators[name]

    def unit(self, name: str) -> int:
        """The N of a generator."""
        return self.units.get(name, 1)

    # -- elements ----------------------------------------------------------------------------------------------

    def _element(self, node: int, signs: Signs) -> RationalFunction:
        """Any node as a quotient of polynomials in generators."""
        known = self._elements.setdefault(signs, {})
        for n in self.program.needed([node], self._signs.union(known)):
            if n not in known:
                known[n] = self._operated(n, signs, known)
                if len(known[n].numerator.terms) + len(known[n].denominator.terms) > _MOST_TERMS:
                    raise UnknownRelationsError(f"a function's argument has more than {_MOST_TERMS} terms")
        return known[node]

    def _operated(self, node: int, signs: Signs, known: Mapping[int, RationalFunction]) -> RationalFunction:
        program, op = self.program, Op(self.program.ops[node])
        if op is Op.INPUT:
            return self._input(node, signs)
        if op is Op.CONSTANT:
            return RationalFunction(program.constants[node])
        if op is Op.SIGN:
            return RationalFunction(dict(signs)[program.lhs[node]])
        if op in (Op.ADD, Op.SUB, Op.MUL, Op.DIV):
            a, b = known[program.lhs[node]], known[program.rhs[node]]
            if op is Op.DIV and not b:
                raise InputError("division by zero in the argument of a function")
            return {Op.ADD: a.__add__, Op.SUB: a.__sub__, Op.MUL: a.__mul__, Op.DIV: a.__truediv__}[op](b)
        if op is Op.NEG:
            return -known[program.lhs[node]]
        if op is Op.ATAN:
            raise UnknownRelationsError("a function of an arc tangent, other than sines of its integer multiples")
        return self._nested(op, self.form(node, signs))

    def _input(self, node: int, signs: Signs) -> RationalFunction:
        name = self.input_generator(node).name
        power = Polynomial.generator(name) ** self.unit(name)
        return RationalFunction(power * (dict(signs)[node] if node in self.rooted and signs else 1))

    def _nested(self, op: Op, form: Form) -> RationalFunction:
        """The form of a function that occurs in the argument of another."""
        if isinstance(form, RationalFunction):
            return form
        if isinstance(form, Product):
            if any(self.generators[g].kind == "root" for g in form.exponents):
                raise UnknownRelationsError("a function of the root of a sum")
            return Atom(tuple(sorted(form.exponents.items()))).element
        cosine, sine = RationalFunction(1), RationalFunction(0)
        for name, count in form.multiples.items():
            if abs(count) > _LARGEST_NESTED_TURN:
                raise UnknownRelationsError(f"a function of a function of {count} times an angle")
            t = Polynomial.generator(name)
            c = RationalFunction(1 - t * t, 1 + t * t)
            s = RationalFunction(2 * t * (1 if count > 0 else -1), 1 + t * t)
            for _ in range(abs(count)):
                cosine, sine = cosine * c - sine * s, cosine * s + sine * c
        return cosine if op is Op.COS else sine

    # -- functions -----------------------------------------------------------------------------------------------

    def form(self, node: int, signs: Signs) -> Form:
        """The form of a function for some signs; final once :meth:`forms` was asked for it."""
        wanted = set(self.signed(node))
        own = tuple(pair for pair in signs if pair[0] in wanted)
        key = (node, own)
        if key not in self._forms:
            argument = self._element(self.program.lhs[node], own)
            self._forms[key] = self._applied(Op(self.program.ops[node]), argument)
        return self._forms[key]

    def _applied(self, op: Op, argument: RationalFunction) -> Form:
        if op in (Op.SIN, Op.COS):
            return Turn(self._multiples("angle", self._bases["angle"].combination(argument)))
        if op is Op.EXP:
            return self._exponential(argument)
        if op is Op.LOG:
            return self._logarithm(argument)
        if op is Op.SQRT:
            return self._powers(argument, Fraction(1, 2))
        if op is Op.ATAN and argument == RationalFunction(1):  # a quarter of pi
            return RationalFunction(Polynomial.generator(self._named("atan", argument, argument, set())))
        if op is Op.ATAN:
            raise UnknownRelationsError("the arc tangent of a constant other than 1")
        raise UnknownRelationsError(f"{op.name.lower()}, whose relations to other functions are not looked for")

    def _multiples(self, kind: str, combination: Sequence[tuple[Fraction, Atom]]) -> dict[str, int]:
        """Integer multiples of the units of atoms."""
        multiples = {}
        for ratio, atom in combination:
            name = self._named(kind, atom, atom.element, atom.generators)
            self._refine(name, lcm(self.unit(name), ratio.denominator))
            multiples[name] = int(ratio * self.unit(name))
        return multiples

    def _exponential(self, argument: RationalFunction) -> Product:
        total: dict[str, int] = {}
        combination = []
        for ratio, atom in self._bases["exp"].combination(argument):
            inner = self.generators[atom.generator] if atom.generator else None
            if inner is not None and inner.kind == "log":
                _add(total, self._powers(inner.element, ratio).exponents)
            else:
                combination.append((ratio, atom))
        _add(total, self._multiples("exp", combination))
        return Product(total)

    def _logarithm(self, argument: RationalFunction) -> RationalFunction:
        """log|argument|."""
        total = RationalFunction(0)
        for factor, exponent in self._factors(argument):
            bare = self._bare(factor)
            if bare is not None and bare.kind == "exp":
                total += bare.element * RationalFunction(Fraction(exponent, self.unit(bare.name)))
                continue
            log = self._named("log", factor, RationalFunction(factor), set(factor.generators()))
            total += RationalFunction(Polynomial.generator(log) * exponent)
        return total

    def _powers(self, argument: RationalFunction, exponent: Fraction) -> Product:
        """|argument|^exponent."""
        total: dict[str, int] = {}
        for factor, count in self._factors(argument):
            ratio = exponent * count
            name = self._rooted(factor, ratio.denominator)
            _add(total, {name: int(ratio * (self.unit(name) if self.generators[name].kind == "root" else 1))})
        return Product(total)

    def _rooted(self, factor: Polynomial, denominator: int) -> str:
        """The generator whose integer powers include |factor|^(1/denominator)."""
        bare = self._bare(factor)
        if bare is None or bare.kind in ("log", "angle"):
            name = self._named("root", factor, RationalFunction(factor), set(factor.generators()))
            self._refine(name, lcm(self.unit(name), denominator))
            return name
        if bare.kind == "input" and bare.node not in self.rooted:
            self.rooted.add(bare.node)
            self._changed = True
        # the generator itself is to become a finer root
        self._refine(bare.name, self.unit(bare.name) * denominator)
        return bare.name

    def _bare(self, factor: Polynomial) -> Generator | None:
        """The generator that a factor is, if it is one."""
        single = len(factor.terms) == 1 and factor.number is None
        return self.generators[factor.generators()[0]] if single else None

    def _factors(self, argument: RationalFunction) -> list[tuple[Polynomial, int]]:
        """|argument| as a product of powers of irreducible polynomials and prime numbers."""
        if not argument:
            raise InputError("the logarithm or root of zero")
        if not (is_rational(argument.numerator) and is_rational(argument.denominator)):
            raise UnknownRelationsError("a logarithm or root of an expression with square roots of numbers")
        result: list[tuple[Polynomial, int]] = []
        for part, sign in ((argument.numerator, 1), (argument.denominator, -1)):
            content, found = factors(part)
            result += [(f, sign * e) for f, e in found]
            for number, side in ((abs(content.numerator), sign), (content.denominator, -sign)):
                result += [(Polynomial.constant(int(q)), side * int(e)) for q, e in flint.fmpz(number).factor()]
        return result

    # -- generators ----------------------------------------------------------------------------------------------

    def _named(self, kind: str, key: object, element: RationalFunction, made_of: set[str]) -> str:
        """The generator of this kind and key, registered on first use."""
        name = self._names.setdefault((kind, key), f"{kind}{len(self._names)}")
        constant = all(self.generators[g].constant for g in made_of)
        self.generators.setdefault(name, Generator(name, kind, element, -1, constant))
        return name

    def _refine(self, name: str, unit: int) -> None:
        if unit > _LARGEST_UNIT:
            digits = len(str(unit))
            raise UnknownRelationsError(f"numbers in functions have a denominator of {digits} digits; round them")
        if unit != self.unit(name):
            self.units[name] = unit
            self._changed = True


def _add(total: dict[str, int], powers: Mapping[str, int]) -> None:
    for name, exponent in powers.items():
        total[name] = total.get(name, 0) + exponent
        if not total[name]:
            del total[name]
