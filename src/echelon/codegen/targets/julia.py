"""Julia: a module of functions that write into a given array."""

from __future__ import annotations

from echelon.codegen.language import Language
from echelon.codegen.numbers import Precision
from echelon.codegen.targets.c import OVERLOADED
from echelon.program.operations import Op

JULIA = Language(
    name="julia",
    files={"{robot}.jl": "julia.jl.j2"},
    comment="# ",
    functions={
        **OVERLOADED,
        Op.ABS: "abs({x})",
        Op.SIGN: "sign({x})",
    },
    number="T({x})",
    real={Precision.DOUBLE: "Float64", Precision.SINGLE: "Float32"},
    separator=", ",
    first=1,
    splits=True,
    zeroed=True,
)
