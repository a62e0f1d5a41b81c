"""The parts of the benchmark of machine code, each of which can be run alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from machine import accuracy, compilation, inverse_dynamics, least_squares, throughput

Report = Callable[[str], None]


def _throughput(quick: bool, repeats: int, report: Report) -> dict[str, Any]:
    return {"regressors": throughput.measured(quick, repeats, report)}


def _dynamics(quick: bool, repeats: int, report: Report) -> dict[str, Any]:
    return {
        "calls": inverse_dynamics.calls(quick, repeats, report),
        "operations": inverse_dynamics.operations(report),
    }


def _compilation(quick: bool, repeats: int, report: Report) -> dict[str, Any]:
    return {
        "to_compiled_c": compilation.to_compiled_c(repeats, report),
        "first_uses": compilation.first_uses(quick, report),
    }


def _least_squares(quick: bool, repeats: int, report: Report) -> dict[str, Any]:
    return {
        "least_squares": least_squares.speed(quick, repeats, report),
        "bad_data": least_squares.bad_data(report),
    }


def _accuracy(quick: bool, repeats: int, report: Report) -> dict[str, Any]:  # noqa: ARG001
    return {"accuracy": accuracy.measured(report)}


PARTS: dict[str, Callable[[bool, int, Report], dict[str, Any]]] = {
    "throughput": _throughput,
    "dynamics": _dynamics,
    "compilation": _compilation,
    "least-squares": _least_squares,
    "accuracy": _accuracy,
}
