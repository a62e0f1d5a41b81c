"""Packages that an import loads at run time, which the import contract in pyproject.toml cannot see."""

from __future__ import annotations

import ast
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


MAKER = "echelon.shared.facade"
"""What makes doors, and has none in front of it."""


def test_rooms_have_doors() -> None:
    """Modules import from another room what its ``__init__.pyi`` names, and no file behind it."""
    behind = []
    for path in SOURCE.rglob("*.py"):
        room = path.relative_to(SOURCE).parts[0]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module not in (None, MAKER):
                package, *inside = node.module.split(".")
                if package == "echelon" and len(inside) > 1 and inside[0] != room:
                    behind.append(f"{path}: {node.module}")
    assert behind == []


def test_names_of_doors_are_no_modules() -> None:
    """A module that is imported becomes an attribute of its package, in place of what the door would give."""
    for stub in SOURCE.rglob("__init__.pyi"):
        names = set(re.findall(r"import\s+\(?\s*\w+ as (\w+)", stub.read_text()))
        modules = {path.stem for path in stub.parent.iterdir()}
        assert names & modules == set(), stub


def test_arms_do_without_loops() -> None:
    script = "import sys, echelon as ec; ec.base_parameters(ec.load(sys.argv[1])); print(*sys.modules)"
    arm = SOURCE.parents[1] / "examples" / "panda.yaml"
    loaded = subprocess.run(
        [sys.executable, "-c", script, arm], capture_output=True, text=True, check=True
    ).stdout
    assert [name for name in loaded.split() if name.startswith("echelon.loops")] == []
