"""FIGAROH's own exciting trajectories, searched for in an environment of its own.

FIGAROH asks for many packages and IPOPT's Python interface, none of which the library needs.  They go into a virtual
environment in the folder of built anchors on first use, unless an interpreter that has them is named.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import venv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from anchors.build import BUILT, HERE, UnavailableError
from anchors.figaroh_tool import VERSION

Floats = npt.NDArray[np.float64]

# cyipopt itself comes as source alone, and FIGAROH's documentation leads to conda; these are wheels, with IPOPT inside
PACKAGES = (f"figaroh=={VERSION}", "cyipopt-wheels==1.7.0.dev0")
_NEEDED = "import cyipopt, figaroh.optimal.base_optimal_trajectory"
_VERSIONS = "import cyipopt, figaroh; print(figaroh.__version__, '.'.join(map(str, cyipopt.IPOPT_VERSION)))"


@dataclass(frozen=True)
class Search:
    """What one search of FIGAROH gave.

    Attributes
    ----------
    seconds : float
        From the model to the motion, base parameters included.
    status : str
    iterations : int
    columns : tuple of int
        Of Pinocchio's regressor, which FIGAROH chose for base columns.
    states : tuple of arrays, optional
        Positions, velocities and accelerations at its samples; None if it found no feasible motion.
    """

    seconds: float
    status: str
    iterations: int
    columns: tuple[int, ...]
    states: tuple[Floats, Floats, Floats] | None


def environment(python: str | None = None, needed: str = _NEEDED) -> str:
    """The interpreter of an environment that holds FIGAROH with its solver.

    Parameters
    ----------
    python : str, optional
        An interpreter to take; else one is made.
    needed : str
        Imports that it must manage.

    Raises
    ------
    UnavailableError
        If it has not what is needed, or the packages cannot be had.
    """
    if python is not None:
        if not _works(python, needed):
            raise UnavailableError(f"{Path(python).name} does not manage: {needed}")
        return python
    folder = BUILT / f"figaroh-{VERSION}-solver"
    made = str(
        folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    )
    if not _works(made):
        _install(folder, made)
    return made


def versions(python: str) -> tuple[str, str]:
    """Of FIGAROH and of its IPOPT."""
    figaroh, ipopt = run_isolated(python, "-c", _VERSIONS).stdout.split()
    return figaroh, ipopt


def searched(python: str, urdf: Path, reach: float, seed: int) -> Search:
    """Let FIGAROH search once.

    Parameters
    ----------
    python : str
        Of `environment`.
    urdf : Path
    reach : float
        Limit of all positions, rad.
    seed : int
    """
    script = HERE.parent / "probes" / "figaroh_trajectory.py"
    done = run_isolated(python, str(script), str(urdf), str(reach), str(seed))
    if done.returncode:
        raise RuntimeError(f"FIGAROH's search failed:\n{done.stderr[-2000:]}")
    told: dict[str, Any] = json.loads(done.stdout)
    states = told.pop("states")
    arrays = (
        None
        if states is None
        else (np.array(states[0]), np.array(states[1]), np.array(states[2]))
    )
    return Search(**{**told, "columns": tuple(told["columns"])}, states=arrays)


def _install(folder: Path, python: str) -> None:
    venv.create(folder, clear=True, with_pip=True)
    done = run_isolated(
        python,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--only-binary",
        "cyipopt-wheels",
        *PACKAGES,
    )
    if done.returncode or not _works(python):
        reasons = [
            line for line in done.stderr.splitlines() if line.startswith("ERROR")
        ]
        raise UnavailableError("; ".join(["it cannot be installed", *reasons[-1:]]))


def _works(python: str, needed: str = _NEEDED) -> bool:
    try:
        return run_isolated(python, "-c", needed).returncode == 0
    except OSError:
        return False


def run_isolated(python: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a program of another environment, with neither this environment's paths nor the script's folder."""
    variables = {**os.environ, "MPLBACKEND": "Agg"}
    return subprocess.run(
        [python, "-I", *arguments],
        env=variables,
        capture_output=True,
        text=True,
        check=False,
    )
