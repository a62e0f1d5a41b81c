"""Rust: functions on fixed arrays, without allocation."""

from __future__ import annotations

from echelon.codegen.language import Language
from echelon.codegen.numbers import Precision
from echelon.codegen.targets.c import OVERLOADED
from echelon.program.operations import Op

RUST = Language(
    name="rust",
    files={"{robot}.rs": "rust.rs.j2"},
    comment="//! ",
    functions={
        **{op: "math::" + pattern for op, pattern in OVERLOADED.items()},
        Op.ABS: "math::abs({x})",
        Op.LOG: "math::ln({x})",
        Op.SIGN: "math::sign({x})",
    },
    real={Precision.DOUBLE: "f64", Precision.SINGLE: "f32"},
    separator="][",
    define="let {name} = {value};",
    assign="{name} = {value};",
    splits=True,
)
