"""What the import contract in pyproject.toml cannot see: the packages that an import loads at run time."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import echelon

SOURCE = Path(echelon.__file__).parent
OPTIONAL = ("casadi", "idyntree", "matplotlib", "mujoco", "pinocchio")


@pytest.mark.parametrize("module", ["echelon", "echelon.cli"])
def test_import_loads_no_optional_package(module: str) -> None:
    script = (
        f"import sys, {module}; print(*sorted({set(OPTIONAL)!r} & sys.modules.keys()))"
    )
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.split() == []


def test_loops_have_one_door() -> None:
    """Whoever is outside imports what ``echelon/loops/__init__.py`` names, and no file behind it."""
    others = [path for path in SOURCE.rglob("*.py") if path.parent != SOURCE / "loops"]
    behind = [
        path
        for path in others
        if re.search(
            r"(from|import) echelon\.loops\.", path.read_text(encoding="utf-8")
        )
    ]
    assert behind == []


def test_arms_do_without_loops() -> None:
    script = "import sys, echelon as ec; ec.base_parameters(ec.load(sys.argv[1])); print(*sys.modules)"
    arm = SOURCE.parents[1] / "examples" / "panda.yaml"
    loaded = subprocess.run(
        [sys.executable, "-c", script, arm], capture_output=True, text=True, check=True
    ).stdout
    assert [name for name in loaded.split() if name.startswith("echelon.loops")] == []
