"""The target languages: for each one configuration of patterns, beside its templates in ``templates/``."""

from __future__ import annotations

from collections.abc import Mapping

from echelon.codegen.language import Language, Precision
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

# C99: a header and a source file
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

# C++17: one header with templates on the scalar type
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

# CUDA C++: device functions, and kernels with one thread for each sample; compiled by nvcc or NVRTC
CUDA = Language(
    name="cuda",
    files={"{robot}.cu": "cuda.cu.j2"},
    comment="// ",
    functions=FUNCTIONS,
    number="{x}{f}",
    real={Precision.DOUBLE: "double", Precision.SINGLE: "float"},
    entry="result[{index}*stride]",
    define="const {real} {name} = {value};",
    assign="{name} = {value};",
    splits=True,
)

# Python with NumPy: functions of arrays with any leading axes
PYTHON = Language(
    name="python",
    files={"{robot}.py": "python.py.j2"},
    comment="# ",
    functions={
        Op.SIN: "np.sin({x})",
        Op.COS: "np.cos({x})",
        Op.TAN: "np.tan({x})",
        Op.EXP: "np.exp({x})",
        Op.LOG: "np.log({x})",
        Op.TANH: "np.tanh({x})",
        Op.SQRT: "np.sqrt({x})",
        Op.ABS: "np.abs({x})",
        Op.SIGN: "np.sign({x})",
        Op.ATAN: "np.arctan({x})",
    },
    real={Precision.DOUBLE: "np.float64", Precision.SINGLE: "np.float32"},
    entry="out[{index}]",
    separator=", ",
    zeroed=True,
)

# JAX: pure functions of one sample, for jit, vmap and grad
JAX = Language(
    name="jax",
    files={"{robot}_jax.py": "jax.py.j2"},
    comment="# ",
    functions={op: pattern.replace("np.", "jnp.") for op, pattern in PYTHON.functions.items()},
    zeroed=True,
)

# CasADi: Python functions that build symbolic functions
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

# MATLAB and Octave: one function file for each function
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

# Julia: a module of functions that write into a given array
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

# Rust: functions on fixed arrays, without allocation
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

TARGETS: Mapping[str, Language] = {
    language.name: language for language in (C, CPP, CUDA, PYTHON, JAX, CASADI, MATLAB, JULIA, RUST)
}
"""All languages by the target's name."""
