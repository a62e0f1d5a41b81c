"""Functions that are written with others when they are recorded, so that nothing else has to know them.

The half angle is taken for arc sines and angles of points, because its tangent is a quotient without jumps:
asin x = 2·atan(x/(1 + √(1 − x²))) and atan2(y, x) = 2·atan(y/(x + √(x² + y²))).  The sine and cosine of twice an arc
tangent are rational in its argument, so that sin(asin x) = x is found exactly.  Double precision keeps eight digits of
atan2 near the negative x-axis, where x + √(x² + y²) cancels.

A multiple of 15° is turned by exactly.  Arc tangents are written out inside sines and cosines: e^(i·atan w) = (1 +
i·w)/√(1 + w²), so sines and cosines of integer multiples of arc tangents, plus anything, are algebraic in their
arguments.

2i·atan w is a logarithm of (1 + i·w)/(1 − i·w).  By Ax's theorem ("On Schanuel's conjectures", Annals of Mathematics
93, 1971) arc tangents are algebraically independent of one another and of the other functions, unless a rational
combination of them and of arguments of sines and cosines is constant in a region.  Then the same combination of their
derivatives vanishes.  So arc tangents whose derivatives are linearly independent of these stand for random elements of
a field; whether they are is decided exactly, region by region.  Where they are not, the combination is constant, but
that constant is not looked for: such relations count as unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce

from echelon.errors import UnknownRelationsError
from echelon.exact.elimination import rank
from echelon.exact.field import PrimeField, Residues
from echelon.exact.numbers import Number
from echelon.program.operations import Op
from echelon.program.tape import Program, Scalar, maximum, minimum, square_root


def heaviside(x: Scalar) -> Scalar:
    """0, ½ or 1 for negative, zero and positive values."""
    return (1 + x.sign()) / 2


COMPOUND: Mapping[str, tuple[int | None, Callable[[Sequence[Scalar]], Scalar]]] = {
    "sinh": (1, lambda a: a[0].sinh()),
    "cosh": (1, lambda a: a[0].cosh()),
    "asin": (1, lambda a: a[0].arcsin()),
    "acos": (1, lambda a: a[0].arccos()),
    "heaviside": (1, lambda a: heaviside(a[0])),
    "atan2": (2, lambda a: a[0].arctan2(a[1])),
    "max": (None, lambda a: reduce(maximum, a)),
    "min": (None, lambda a: reduce(minimum, a)),
}
"""By name: the number of arguments, None for any, and what is recorded."""


def turned(op: Op, rest: Scalar, cosine: Number, sine: Number) -> Scalar:
    """A circular function of an angle plus one whose cosine and sine are given."""
    program = rest.program
    if cosine == 1:
        return program.function(op, rest)
    c, s = program.cos(rest), program.sin(rest)
    whole_cosine, whole_sine = c * cosine - s * sine, s * cosine + c * sine
    return whole_sine / whole_cosine if op is Op.TAN else whole_cosine if op is Op.COS else whole_sine


_LARGEST_MULTIPLE = 24


def circular(op: Op, angle: Scalar) -> Scalar:
    """Sine or cosine of an angle that may hold integer multiples of arc tangents."""
    program = angle.program
    arcs: dict[int, int] = {}
    rest = _without_arcs(program, angle.node, 1, arcs)
    counts = {program.lhs[n]: count for n, count in arcs.items() if count}
    if not counts or any(abs(count) > _LARGEST_MULTIPLE for count in counts.values()):
        return program.function(op, angle)
    cosine, sine = program.cos(rest), program.sin(rest)
    for node, count in counts.items():
        w = Scalar(program, node) if count > 0 else -Scalar(program, node)
        below = (1 + w * w) ** (abs(count) // 2)
        for _ in range(abs(count)):
            cosine, sine = cosine - sine * w, sine + cosine * w
        below = below * square_root(1 + w * w) if count % 2 else below
        cosine, sine = cosine / below, sine / below
    return sine if op is Op.SIN else cosine


def _without_arcs(program: Program, node: int, factor: int, arcs: dict[int, int]) -> Scalar:
    """factor · node without its integer multiples of arc tangents, which are counted."""
    op, a, b = Op(program.ops[node]), program.lhs[node], program.rhs[node]
    if op is Op.ATAN:
        arcs[node] = arcs.get(node, 0) + factor
        return program.zero
    if op is Op.NEG:
        return _without_arcs(program, a, -factor, arcs)
    if op in (Op.ADD, Op.SUB):
        other = factor if op is Op.ADD else -factor
        return _without_arcs(program, a, factor, arcs) + _without_arcs(program, b, other, arcs)
    if op is Op.MUL:
        for number, value in ((program.constants.get(a), b), (program.constants.get(b), a)):
            if isinstance(number, int):
                return _without_arcs(program, value, factor * number, arcs)
    return Scalar(program, node) * factor


def check_independent(slopes: Residues, arcs: int, regions: int, field: PrimeField) -> None:
    """Check arc tangents by the derivatives of them and of arguments of sines and cosines."""
    # shapes: slopes (functions, inputs, states)
    for region in range(regions):
        table = slopes[:, :, region::regions].reshape(len(slopes), -1).T
        angles = rank(table[:, arcs:], field) if arcs < len(slopes) else 0
        if rank(table, field) < arcs + angles:
            raise UnknownRelationsError("arc tangents that differ by a constant, or from an angle, in some region")
