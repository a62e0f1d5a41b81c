"""The ``derive`` command for linear models."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from echelon.base.derive import base_parameters
from echelon.base.display import to_latex, to_markdown, to_text
from echelon.errors import InputError
from echelon.formats.linear import load_linear
from echelon.results.linear import linear_to_json


def linear_text(
    file: Path,
    output_format: str,
    order: str,
    prefer: Sequence[str],
    seed: int,
    budget: float,
    *,
    structure: bool,
    generic: bool,
) -> str:
    """Base parameters of the linear model in a file, in an output format."""
    if structure:
        raise InputError("--structure is for robots; a linear model is always derived in closed form")
    base = base_parameters(load_linear(file), order=order, prefer=prefer, generic=generic, seed=seed, budget=budget)
    if output_format == "text":
        return to_text(base) + "\n"
    return {"json": linear_to_json, "latex": to_latex, "markdown": to_markdown}[output_format](base)
