"""CasADi: Python functions that build symbolic functions."""

from __future__ import annotations

from echelon.codegen.language import Language
from echelon.codegen.targets.python import PYTHON
from echelon.program.operations import Op

CASADI = Language(
    name="casadi",
    files={"{robot}_casadi.py": "casadi.py.j2"},
    comment="# ",
    functions={
        **{op: pattern.replace("np.", "ca.") for op, pattern in PYTHON.functions.items()},
        Op.ABS: "ca.fabs({x})",
        Op.ATAN: "ca.atan({x})",
    },
    separator=", ",
    zeroed=True,
)
