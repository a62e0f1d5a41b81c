"""The public face: what it offers, and that all of it is documented and typed."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import subprocess
import sys
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest

import echelon as ec

PUBLIC = [
    "AssemblyWarning", "Audit", "BaseModel", "Calibration", "CalibrationPoses", "CalibrationScore",
    "CertificateError", "ClosedFormError", "Comparison", "DoubtWarning", "EchelonError", "Equality", "Estimate",
    "ExcitingTrajectory", "Experiment", "Expression", "Identifiability", "Identification", "InputError", "LinearBase",
    "LinearModel", "Match", "Mechanism", "MissingExtraError", "NormalEquations", "NumericComparison", "Observation",
    "OnlineEstimator", "Payload", "RecordedRows", "RowSpaces", "SampledRank", "SensorReport", "ServoFit", "Setup",
    "SpecialGeometry", "Structure",
    "SymbolicRegressor", "Trajectory", "Verdict", "__version__", "audit", "base_parameters", "base_structure",
    "calibrate", "calibration_base", "calibration_html", "calibration_poses", "compare", "compare_numeric", "convert",
    "convert_columns", "drive_gains", "energy_regressor", "exciting_trajectory", "fit_servos", "gains_from_logs",
    "generate", "identify", "information_of_logs", "joined", "joint_side", "judged_trajectory", "load", "load_base",
    "load_identified", "load_linear", "load_linear_base", "load_model", "load_setup", "low_pass", "match", "motion_ranks",
    "online", "plan", "power_regressor", "predict_log", "preview_html", "read_trajectory", "report_html", "same_row_space",
    "sampled_rank", "save_base", "save_identification", "sensor_report", "special_geometry", "verify", "write_trajectory",
]  # fmt: skip


def test_public_names_are_pinned() -> None:
    assert ec.__all__ == PUBLIC
    assert all(hasattr(ec, name) for name in PUBLIC)


def test_names_are_declared_once_for_type_checkers_and_python() -> None:
    """The stub that both read has one import per public name and nothing else."""
    docstring, *imports = ast.parse(
        Path(ec.__file__).with_suffix(".pyi").read_text(encoding="utf-8")
    ).body
    assert isinstance(docstring, ast.Expr)
    declared = {
        a.asname: n.module
        for n in imports
        if isinstance(n, ast.ImportFrom)
        for a in n.names
    }
    assert sorted(declared) == ec.__all__
    assert len(declared) == len(imports)
    assert all(
        getattr(ec, name).__module__ == module
        for name, module in declared.items()
        if name[0] != "_"
    )


def test_importing_echelon_imports_nothing_heavy() -> None:
    script = "import sys, echelon; print(*sorted({'numpy', 'flint', 'sympy', 'llvmlite', 'yaml'} & sys.modules.keys()))"
    assert not subprocess.check_output(
        [sys.executable, "-c", script], text=True
    ).strip()


MODULES = [
    module.name
    for module in pkgutil.walk_packages(ec.__path__, "echelon.")
    # a program of its own, which nobody imports from
    if not module.name.endswith(".echelon_verify")
]


def functions(module: ModuleType) -> Iterator[Callable[..., object]]:
    """Public functions and methods that a module defines."""
    for name, member in vars(module).items():
        if (
            name.startswith("_")
            or getattr(member, "__module__", None) != module.__name__
        ):
            continue
        if inspect.isfunction(member):
            yield member
        elif inspect.isclass(member):
            for key, method in vars(member).items():
                if inspect.isfunction(method) and not key.startswith("_"):
                    yield method


@pytest.mark.parametrize("name", MODULES)
def test_functions_are_documented_and_typed(name: str) -> None:
    for function in functions(importlib.import_module(name)):
        assert inspect.getdoc(function), function
        annotations = inspect.get_annotations(function)
        named = [p for p in inspect.signature(function).parameters if p != "self"]
        assert set(named) <= set(annotations) | {"cls"}, function
        assert "return" in annotations, function


def facade() -> Iterator[object]:
    for name in ec.__all__:
        member = getattr(ec, name)
        if inspect.isfunction(member):
            yield pytest.param(member, None, id=name)
        elif inspect.isclass(member) and not issubclass(member, Exception):
            for owner in member.__mro__:
                if owner.__module__.startswith("echelon"):
                    for key, method in vars(owner).items():
                        if inspect.isfunction(method) and not key.startswith("_"):
                            yield pytest.param(method, owner, id=f"{name}.{key}")


@pytest.mark.parametrize(("function", "owner"), list(facade()))
def test_every_argument_is_explained(
    function: Callable[..., object], owner: type | None
) -> None:
    """Where it is, or once for all methods of a class that says so."""
    text = inspect.getdoc(function) or ""
    if owner is not None and f":class:`{owner.__name__}`" in text:
        text += inspect.getdoc(owner) or ""
    for name in inspect.signature(function).parameters:
        assert name == "self" or name in text, name


def test_errors_share_a_root() -> None:
    errors = [getattr(ec, name) for name in PUBLIC if name.endswith("Error")]
    assert all(issubclass(error, ec.EchelonError) for error in errors)
    assert typing.get_type_hints(ec.InputError.__init__)
