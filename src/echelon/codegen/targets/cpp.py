"""C++17: one header with templates on the scalar type."""

from __future__ import annotations

from echelon.codegen.language import Language
from echelon.codegen.targets.c import OVERLOADED
from echelon.program.operations import Op

CPP = Language(
    name="cpp",
    files={"{robot}.hpp": "cpp.hpp.j2"},
    comment="// ",
    # unqualified, so that scalars of other libraries bring their own
    functions={**OVERLOADED, Op.ABS: "abs({x})"},
    number="T({x})",
    define="const T {name} = {value};",
    assign="{name} = {value};",
    windows=True,
    splits=True,
    zeroed=True,
)
