"""The target languages, one configuration each."""

from __future__ import annotations

from collections.abc import Mapping

from echelon.codegen.language import Language
from echelon.codegen.targets.c import C
from echelon.codegen.targets.casadi import CASADI
from echelon.codegen.targets.cpp import CPP
from echelon.codegen.targets.cuda import CUDA
from echelon.codegen.targets.jax import JAX
from echelon.codegen.targets.julia import JULIA
from echelon.codegen.targets.matlab import MATLAB
from echelon.codegen.targets.python import PYTHON
from echelon.codegen.targets.rust import RUST

TARGETS: Mapping[str, Language] = {
    language.name: language for language in (C, CPP, CUDA, PYTHON, JAX, CASADI, MATLAB, JULIA, RUST)
}
"""All languages by the target's name."""
