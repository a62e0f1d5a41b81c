"""FIGAROH's functions that build a regressor of many samples and choose its base columns, run on a Pinocchio model.

The package asks for a dozen others that have no part in this.  The two modules that count need only NumPy, SciPy and
Pinocchio, so they are fetched alone, into the folder of built anchors, and nothing that is installed changes.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt

from anchors.build import BUILT, UnavailableError

Floats = npt.NDArray[np.float64]

VERSION = "1.0.2"
_TOOLS = Path("figaroh", "tools")


def regressor_builder(model: Any) -> Callable[[Floats, Floats, Floats], Floats]:
    """What a user calls: positions, velocities and accelerations in, the stacked regressor out.

    Raises
    ------
    UnavailableError
        If the package is neither here nor to be had.
    """
    module = _module("regressor")
    # the least that it needs; the robot class of the package takes a longer way to the same routine
    robot = SimpleNamespace(model=model, data=model.createData())
    options = {"is_joint_torques": True, "act_idxv": []}
    return lambda q, qd, qdd: module.build_regressor_basic(robot, q, qd, qdd, options)


def base_columns(regressor: Floats) -> int:
    """How many base parameters FIGAROH finds in a stacked regressor, with its own tolerance."""
    names = [f"{column:04}" for column in range(regressor.shape[1])]
    return len(_module("qrdecomposition").get_baseIndex(regressor, names))


@cache
def _module(name: str) -> ModuleType:
    path = _fetched() / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"figaroh_{name}", path)
    assert isinstance(spec, ModuleSpec)
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def _fetched() -> Path:
    folder = BUILT / f"figaroh-{VERSION}"
    path = folder / _TOOLS
    if not path.exists():
        command = [
            sys.executable,
            "-m",
            "pip",
            "install",
            "--quiet",
            "--no-deps",
            "--target",
            str(folder),
        ]
        done = subprocess.run(
            [*command, f"figaroh=={VERSION}"],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode or not path.exists():
            raise UnavailableError(
                f"figaroh {VERSION} cannot be fetched: {done.stderr.strip().splitlines()[-1:]}"
            )
    return path
