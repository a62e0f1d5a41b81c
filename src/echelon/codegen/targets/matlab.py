"""MATLAB and Octave: one function file for each function."""

from __future__ import annotations

from echelon.codegen.language import Language
from echelon.codegen.targets.c import OVERLOADED
from echelon.program.operations import Op

MATLAB = Language(
    name="matlab",
    files={"{robot}_{function}.m": "matlab.m.j2"},
    comment="% ",
    functions={
        **OVERLOADED,
        Op.ABS: "abs({x})",
        Op.SIGN: "sign({x})",
    },
    element="{name}({index})",
    entry="result({index})",
    separator=", ",
    define="{name} = {value};",
    assign="{name} = {value};",
    first=1,
    zeroed=True,
)
