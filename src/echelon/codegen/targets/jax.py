"""JAX: pure functions of one sample, for jit, vmap and grad."""

from __future__ import annotations

from echelon.codegen.language import Language
from echelon.codegen.targets.python import PYTHON

JAX = Language(
    name="jax",
    files={"{robot}_jax.py": "jax.py.j2"},
    comment="# ",
    functions={op: pattern.replace("np.", "jnp.") for op, pattern in PYTHON.functions.items()},
    zeroed=True,
)
