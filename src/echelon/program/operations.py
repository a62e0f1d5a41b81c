"""The operations of straight-line programs."""

from __future__ import annotations

from enum import IntEnum


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


FUNCTIONS = tuple(op for op in Op if op >= Op.SIN)
"""The unary functions other than negation."""
