"""The operations of a program, and the exact values of functions at numbers where these are known."""

from __future__ import annotations

from enum import IntEnum

from echelon.algebra.exact.polynomial import Number, is_negative
from echelon.shared import InputError


class Op(IntEnum):
    """Operation codes.  Unary functions follow ``SIN``; their operand is ``lhs``."""

    INPUT = 0
    CONSTANT = 1
    ADD = 2
    SUB = 3
    MUL = 4
    NEG = 5
    DIV = 6
    SIN = 7
    COS = 8
    TAN = 9
    EXP = 10
    LOG = 11
    TANH = 12
    SQRT = 13
    ABS = 14
    SIGN = 15
    ATAN = 16


FUNCTIONS = tuple(
    op for op in Op if op >= Op.SIN
)  # the unary functions other than negation


def folded(op: Op, value: Number) -> Number | None:
    """The exact value of a function at a number, where there is one."""
    sign = -1 if is_negative(value) else int(bool(value))
    if op in (Op.LOG, Op.SQRT) and (sign < 0 or (op is Op.LOG and not sign)):
        raise InputError(f"{op.name.lower()}({value}) is not real")
    if op is Op.SIGN:
        return sign
    if op is Op.ABS:
        return value * sign
    if op is Op.LOG:
        return 0 if value == 1 else None
    if sign:
        return None
    return 1 if op in (Op.COS, Op.EXP) else 0
