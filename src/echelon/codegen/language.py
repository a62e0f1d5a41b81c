"""Target languages: patterns for expressions and statements, beside templates in ``templates/`` for everything around.

Names and text from files are made safe for a language's identifiers and comments.  A new target is one configuration
at the end of this file and its templates.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from math import isfinite

import numpy as np

from echelon.algebra import FUNCTIONS as OPERATIONS
from echelon.algebra import Number, Op
from echelon.shared import InputError, one_line

# words that a language reserves, or that name a library which the generated code itself uses
_WORDS = """
abstract alignas alignof and and_eq as asm async auto await base baremodule become begin bitand bitor bool box
break case casadi catch char class classdef compl complex concept const constexpr continue core crate cuda def
default del delete do double dyn elif else elseif end enum error except explicit export extern false final finally
float fn for foreach friend from function global goto if impl import in inline int is jax lambda let local long
loop macro main match math mod module move mut mutable namespace new none nonlocal not numpy operator or otherwise
override parfor pass persistent pi priv private protected pub public quote raise ref register return self short
signed sizeof spmd static std string struct super switch template test this throw trait true try type typedef
typeid typename typeof union unsafe unsigned unsized use using var virtual void volatile where while with xor yield
"""
_TAKEN = frozenset(_WORDS.split())
LONGEST_NAME = 48
"""Characters of a name of a file or function that is made of a robot's name."""


def identifier(text: str) -> str:
    r"""A name that is an identifier in every target language, in lower case.

    >>> identifier("UR10 (e-series)"), identifier("3R"), identifier("*/ system(\"x\")"), identifier("class")
    ('ur10_e_series', 'robot_3r', 'system_x', 'class_robot')
    """
    name = re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")[:LONGEST_NAME].strip("_")
    if not name or name[0].isdigit():
        name = f"robot_{name}".strip("_")
    return f"{name}_robot" if name in _TAKEN else name


def checked_identifier(text: str) -> str:
    """A name that a user chose."""
    simple = re.fullmatch(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*", text)
    if not simple or text.lower() in _TAKEN or len(text) > 2 * LONGEST_NAME:
        raise InputError(
            f"'{one_line(text)}' cannot be used as a name: letters, digits and single underscores, starting with a "
            "letter, and no word that one of the target languages reserves"
        )
    return text


def comment_text(text: str) -> str:
    r"""Text for a comment, in one line and unable to end the comment in any target language.

    >>> comment_text("a */ system(\"x\")\nb \\")
    'a * / system("x") b /'
    """
    line = one_line(text).replace("\\", "/")
    return re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)|(?<=\?)(?=\?)", " ", line).rstrip()


_ASCII = str.maketrans({"·": "*", "²": "^2", "³": "^3", "−": "-"})


def unit_text(unit: str) -> str:
    """A unit in ASCII: ``kg*m^2``."""
    return unit.translate(_ASCII)


class Precision(StrEnum):
    """Floating-point types of generated code."""

    DOUBLE = "double"
    SINGLE = "single"

    @property
    def suffix(self) -> str:
        """Suffix of C's literals and functions for this precision."""
        return "f" if self is Precision.SINGLE else ""


def decimal(value: Number, precision: Precision) -> str:
    """The shortest decimal of a number, always with a point or an exponent.

    >>> from fractions import Fraction
    >>> decimal(Fraction(1, 3), Precision.DOUBLE), decimal(Fraction(1, 3), Precision.SINGLE)
    ('0.3333333333333333', '0.33333334')
    """
    with np.errstate(over="ignore"):
        rounded = (
            float(value) if precision is Precision.DOUBLE else np.float32(float(value))
        )
    if not isfinite(rounded):
        raise InputError(f"{float(value):.3g} is too large for {precision} precision")
    return str(rounded)


@dataclass(frozen=True)
class Language:
    """How a language writes things."""

    name: str  # the target's name
    # templates by the pattern of the file's name: ``{robot}`` is the robot's identifier; with ``{function}`` there is
    # one file for each function
    files: Mapping[str, str]
    comment: str  # opens every line of documentation
    # patterns of functions of ``{x}``.  Here and in :attr:`number`, ``{f}`` is ``f`` in single precision and empty in
    # double precision
    functions: Mapping[Op, str]
    number: str = "{x}"  # pattern of a literal with the decimal ``{x}``
    # floating-point types
    real: Mapping[Precision, str] = field(
        default_factory=lambda: {p: p.value for p in Precision}
    )
    element: str = (
        "{name}[{index}]"  # pattern of entry ``{index}`` of the vector ``{name}``
    )
    entry: str = "result[{index}]"  # pattern of the entry ``{index}`` of the result
    # stands between the indices of an entry of the result; None for one index into a dense row-major array
    separator: str | None = None
    # patterns of the statements that give ``{name}`` the value ``{value}``, for the first time or otherwise
    define: str = "{name} = {value}"
    assign: str = "{name} = {value}"
    first: int = 0  # the first index
    # whether the templates make results that start as zeros; otherwise zeros are assigned, or filled in if there are
    # many
    zeroed: bool = False
    splits: bool = False  # whether long functions are cut into parts
    longest_name: int | None = None  # letters of an identifier that count
    estimates: bool = False  # whether the templates have recursive least squares

    def literal(self, value: Number, precision: Precision) -> str:
        """A constant that is not negative."""
        return self.number.format(x=decimal(value, precision), f=precision.suffix)

    def call(self, op: Op, x: str, precision: Precision) -> str:
        """A function of an expression."""
        return self.functions[op].format(x=x, f=precision.suffix)

    def at(self, name: str, index: int) -> str:
        """An entry of a vector."""
        return self.element.format(name=name, index=index + self.first)

    def result_at(self, index: tuple[int, ...], shape: tuple[int, ...]) -> str:
        """An entry of the result."""
        if self.separator is None:
            place = 0
            for k, size in zip(index, shape, strict=True):
                place = place * size + k
            return self.entry.format(index=place + self.first)
        return self.entry.format(
            index=self.separator.join(str(k + self.first) for k in index)
        )


C_FUNCTIONS = {op: f"{op.name.lower()}{{f}}({{x}})" for op in OPERATIONS}
C_FUNCTIONS |= {Op.ABS: "fabs{f}({x})", Op.SIGN: "sign_of({x})"}
"""Functions of C's library, and a sign of our own."""

OVERLOADED = {op: pattern.format(f="", x="{x}") for op, pattern in C_FUNCTIONS.items()}
"""The same for languages in which one name serves all types."""

_WITH_SIGN = OVERLOADED | {Op.ABS: "abs({x})", Op.SIGN: "sign({x})"}

# C99: a header and a source file
C = Language(
    name="c",
    files={"{robot}.h": "c.h.j2", "{robot}.c": "c.c.j2"},
    comment=" * ",
    functions=C_FUNCTIONS,
    number="{x}{f}",
    real={Precision.DOUBLE: "double", Precision.SINGLE: "float"},
    define="const {real} {name} = {value};",
    assign="{name} = {value};",
    splits=True,
    estimates=True,
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
    splits=True,
    zeroed=True,
)

# CUDA C++: device functions, and kernels with one thread for each sample; compiled by nvcc or NVRTC
CUDA = replace(
    C,
    name="cuda",
    files={"{robot}.cu": "cuda.cu.j2"},
    comment="// ",
    entry="result[{index}*stride]",
    estimates=False,
)

# Python with NumPy: functions of arrays with any leading axes
PYTHON = Language(
    name="python",
    files={"{robot}.py": "python.py.j2"},
    comment="# ",
    functions={op: f"np.{op.name.lower()}({{x}})" for op in OPERATIONS}
    | {Op.ATAN: "np.arctan({x})"},
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
    functions={
        op: pattern.replace("np.", "jnp.") for op, pattern in PYTHON.functions.items()
    },
    zeroed=True,
)

# CasADi: Python functions that build symbolic functions
CASADI = Language(
    name="casadi",
    files={"{robot}_casadi.py": "casadi.py.j2"},
    comment="# ",
    functions={
        **{
            op: pattern.replace("np.", "ca.")
            for op, pattern in PYTHON.functions.items()
        },
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
    functions=_WITH_SIGN,
    element="{name}({index})",
    entry="result({index})",
    separator=", ",
    define="{name} = {value};",
    assign="{name} = {value};",
    first=1,
    zeroed=True,
    longest_name=63,  # namelengthmax
)

# Julia: a module of functions that write into a given array
JULIA = Language(
    name="julia",
    files={"{robot}.jl": "julia.jl.j2"},
    comment="# ",
    functions=_WITH_SIGN,
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
    functions={op: f"math::{pattern}" for op, pattern in _WITH_SIGN.items()}
    | {Op.LOG: "math::ln({x})"},
    real={Precision.DOUBLE: "f64", Precision.SINGLE: "f32"},
    separator="][",
    define="let {name} = {value};",
    assign="{name} = {value};",
    splits=True,
)

TARGETS = {
    language.name: language
    for language in (C, CPP, CUDA, PYTHON, JAX, CASADI, MATLAB, JULIA, RUST)
}
"""All languages by the target's name."""
