"""The measurements: start-up, robots beside a numeric tool, chains of growing length."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

import echelon as ec
import numeric
from echelon.algebra.exact.field import DEFAULT_SEED
from echelon.base.certificate import certify
from echelon.base.derive import base_matrix
from echelon.base.matrix import BaseMatrix
from echelon.base.structure import Structure, find_structure
from echelon.dynamics.linear_forms import virtual_power_form
from echelon.robot.mechanism import Mechanism
from robots import Robot, binary_tree, chain, serial_model
from timing import Times, interleaved

_HELP = (
    "import sys; sys.argv = ['echelon', '--help']; from echelon.cli import main; main()"
)
_PANDA = str(Path(__file__).parents[1] / "examples" / "panda.yaml")
_DERIVE = (
    f"import sys; sys.argv = ['echelon', 'derive', {_PANDA!r}]; "
    "from echelon.cli import main; main()"
)
_PROGRAMS = {
    "python, nothing imported": "pass",
    "import echelon": "import echelon",
    "import echelon, load and base_parameters": "from echelon import base_parameters, load",
    "echelon --help": _HELP,
    "echelon derive examples/panda.yaml": _DERIVE,
    "import pinocchio": "import pinocchio",
}
_FITTED_FROM = 10  # joints; below, fixed costs hide the growth

Report = Callable[[str], None]


def start_up(repeats: int, report: Report) -> dict[str, Times]:
    """Whole processes, interpreter included; bytecode is kept between them, as where a package is installed."""
    report("start-up")
    kept = {
        name: value
        for name, value in os.environ.items()
        if name != "PYTHONDONTWRITEBYTECODE"
    }

    def process(program: str) -> Callable[[], Any]:
        return lambda: subprocess.run(
            [sys.executable, "-c", program], check=True, capture_output=True, env=kept
        )

    return interleaved(
        {name: process(program) for name, program in _PROGRAMS.items()}, repeats
    )[0]


def robots(
    chosen: Iterable[Robot], repeats: int, report: Report
) -> list[dict[str, Any]]:
    """Every robot, exactly and numerically; reading the file is left out on both sides."""
    rows = []
    for robot in chosen:
        report(robot.name)
        mechanism, model = robot.exact(), robot.numeric()
        times, results = interleaved(
            {
                "closed_forms": lambda m=mechanism: ec.base_parameters(m),
                "structure": lambda m=mechanism: ec.base_structure(m),
                "numeric_qr": lambda m=model: numeric.rank_by_qr(m),
                "numeric_svd": lambda m=model: numeric.rank_by_svd(m),
            },
            repeats,
        )
        base = results["closed_forms"]
        rows.append(
            {
                "robot": robot.name,
                "variant": robot.variant,
                "bodies": len(mechanism.bodies),
                "symbols": len(mechanism.symbols),
                "parameters": len(base.parameters),
                "rank": base.rank,
                "literal_rank": base.reading.literal_rank,
                "rank_numeric_qr": results["numeric_qr"],
                "rank_numeric_svd": results["numeric_svd"],
                "seconds": {name: t.as_dict() for name, t in times.items()},
                "structure_per_numeric_svd": round(
                    times["structure"].median / times["numeric_svd"].median, 3
                ),
                "closed_forms_per_numeric_svd": round(
                    times["closed_forms"].median / times["numeric_svd"].median, 3
                ),
            }
        )
    return rows


def classical_matrix(mechanism: Mechanism, structure: Structure) -> BaseMatrix:
    """B in closed form for the classical order, from the base to the tip."""
    order = tuple(range(structure.parameters))
    return base_matrix(
        mechanism,
        structure,
        order,
        np.random.default_rng(DEFAULT_SEED),
        1.0,
        lambda _: None,
    )


def chains(
    lengths: Iterable[int], repeats: int, report: Report
) -> list[dict[str, Any]]:
    """Serial chains; the three parts of a derivation are timed apart."""
    rows = []
    for joints in lengths:
        report(f"chain of {joints}")
        mechanism = chain(joints)
        model = serial_model(mechanism)
        structure = find_structure(mechanism, np.random.default_rng(DEFAULT_SEED))
        matrix = classical_matrix(mechanism, structure)
        times, results = interleaved(
            {
                "structure": lambda m=mechanism: find_structure(
                    m, np.random.default_rng(DEFAULT_SEED)
                ),
                "closed_forms": lambda m=mechanism, s=structure: classical_matrix(m, s),
                "certificate": lambda m=mechanism, b=matrix: certify(
                    virtual_power_form(m), b, DEFAULT_SEED
                ),
                "numeric_svd": lambda m=model: numeric.rank_by_svd(m),
            },
            repeats,
        )
        rows.append(
            {
                "joints": joints,
                "symbols": len(mechanism.symbols),
                "rank": matrix.rank,
                "rank_numeric_svd": results["numeric_svd"],
                "entries": sum(len(row) for row in matrix.rows),
                "seconds": {name: t.as_dict() for name, t in times.items()},
            }
        )
    return rows


def large(repeats: int, report: Report) -> list[dict[str, Any]]:
    """Large mechanisms with a symbol for every offset, from the mechanism to the certificate."""
    rows = []
    for mechanism in (chain(500), binary_tree(255)):
        report(mechanism.name)
        times, results = interleaved(
            {"derive": lambda m=mechanism: ec.base_parameters(m)}, repeats
        )
        base = results["derive"]
        counted = {
            "bodies": len(mechanism.bodies),
            "symbols": len(mechanism.symbols),
            "rank": base.rank,
        }
        rows.append(
            {
                "mechanism": mechanism.name,
                **counted,
                "seconds": times["derive"].as_dict(),
            }
        )
    return rows


def exponents(rows: list[dict[str, Any]]) -> dict[str, float | None]:
    """Exponent e of the cost joints^e, fitted to the medians of the longer chains."""
    long = [row for row in rows if row["joints"] >= _FITTED_FROM]
    fitted: dict[str, float | None] = {}
    for part in ("structure", "closed_forms", "certificate", "numeric_svd"):
        seconds = [row["seconds"][part]["median"] for row in long]
        joints = [row["joints"] for row in long]
        slope = (
            np.polyfit(np.log(joints), np.log(seconds), 1)[0] if len(long) > 1 else None
        )
        fitted[part] = None if slope is None else round(float(slope), 2)
    return fitted
