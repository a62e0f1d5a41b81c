"""CUDA C++: device functions, and kernels with one thread for each sample; compiled by nvcc or NVRTC."""

from __future__ import annotations

from echelon.codegen.language import Language
from echelon.codegen.numbers import Precision
from echelon.codegen.targets.c import FUNCTIONS

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
