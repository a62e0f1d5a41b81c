"""What the import contract in pyproject.toml cannot see: the packages that an import loads at run time."""

from __future__ import annotations

import subprocess
import sys

import pytest

OPTIONAL = ("casadi", "idyntree", "matplotlib", "mujoco", "pinocchio")


@pytest.mark.parametrize("module", ["echelon", "echelon.cli"])
def test_import_loads_no_optional_package(module: str) -> None:
    script = f"import sys, {module}; print(*sorted({set(OPTIONAL)!r} & sys.modules.keys()))"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert result.stdout.split() == []
