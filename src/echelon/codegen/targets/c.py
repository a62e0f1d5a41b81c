"""C99: a header and a source file."""

from __future__ import annotations

from echelon.codegen.language import Language
from echelon.codegen.numbers import Precision
from echelon.program.operations import Op

FUNCTIONS = {
    Op.SIN: "sin{f}({x})",
    Op.COS: "cos{f}({x})",
    Op.TAN: "tan{f}({x})",
    Op.EXP: "exp{f}({x})",
    Op.LOG: "log{f}({x})",
    Op.TANH: "tanh{f}({x})",
    Op.SQRT: "sqrt{f}({x})",
    Op.ABS: "fabs{f}({x})",
    Op.SIGN: "sign_of({x})",
    Op.ATAN: "atan{f}({x})",
}
"""Functions of C's library, and a sign of our own."""

OVERLOADED = {op: pattern.format(f="", x="{x}") for op, pattern in FUNCTIONS.items()}
"""The same for languages in which one name serves all types."""

C = Language(
    name="c",
    files={"{robot}.h": "c.h.j2", "{robot}.c": "c.c.j2"},
    comment=" * ",
    functions=FUNCTIONS,
    number="{x}{f}",
    real={Precision.DOUBLE: "double", Precision.SINGLE: "float"},
    define="const {real} {name} = {value};",
    assign="{name} = {value};",
    windows=True,
    splits=True,
)
