"""The ``generate`` command."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from time import perf_counter
from typing import Any

import typer

from echelon.base.derive import base_parameters
from echelon.base.model import BaseModel
from echelon.cli.options import Order, reading
from echelon.cli.progress import progress, say_time
from echelon.codegen.constants import FROM_FILE
from echelon.codegen.documentation import operation_counts, operations_text
from echelon.codegen.generate import Source, generate_source
from echelon.errors import InputError, one_line
from echelon.files import write_atomically
from echelon.formats.linear import holds_linear_model
from echelon.formats.load import load
from echelon.results.record import SCHEMA_NAME
from echelon.results.saved import load_base

SUMMARY = "echelon.generated/1"
"""Schema of the summary."""


@dataclass(frozen=True)
class GenerateRequest:
    """Arguments of the command.

    Attributes
    ----------
    robot : Path
        A robot file, or base parameters saved as JSON.
    output : Path
        A directory, or a file.
    reading, derivation, options : mappings
        Keyword arguments of ``load``, ``base_parameters`` and ``generate``.
    parameters : str, optional
        ``"file"`` or the name of a file of values.
    """

    robot: Path
    output: Path
    reading: Mapping[str, Any]
    derivation: Mapping[str, Any]
    options: Mapping[str, Any]
    parameters: str | None


def run_generate(request: GenerateRequest, *, as_json: bool) -> None:
    """Generate, write all files, and say what was written."""
    started = perf_counter()
    given = request.parameters
    values = given if given is None or given == FROM_FILE else read_values(Path(given))
    with progress(f"generating code for {request.robot.name}"):
        base = _base(request)
        source = generate_source(base, **request.options, parameters=values)
    paths = _paths(list(source.files), request.output)
    for path, text in zip(paths, source.files.values(), strict=True):
        write_atomically(path, text)
    if as_json:
        typer.echo(json.dumps(_summary(base, source, paths, request), indent=1, ensure_ascii=False))
        return
    for function in source.functions:
        typer.echo(f"{function.name}: {operations_text(function)}")
    typer.echo(f"wrote {', '.join(one_line(str(path)) for path in paths)}")
    say_time(started)


def read_values(path: Path) -> dict[str, float]:
    """Values by name, from a JSON object or from lines ``name,value``.

    Raises
    ------
    InputError
        If the file cannot be read or holds something else.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read: {error}", source=str(path)) from None
    try:
        pairs = list(json.loads(text).items()) if text.lstrip().startswith("{") else _csv_pairs(text)
        found = {str(name).strip(): float(value) for name, value in pairs}
    except (ValueError, TypeError):
        raise InputError('expected {"name": value, ...} or lines name,value', source=str(path)) from None
    if len(found) < len(pairs):
        raise InputError("a name occurs twice", source=str(path))
    return found


def _csv_pairs(text: str) -> list[tuple[str, str]]:
    """Rows of two cells; a first row without a number is a heading."""
    rows = [row for row in csv.reader(StringIO(text)) if any(cell.strip() for cell in row)]
    if rows and len(rows[0]) == 2 and rows[0][1].strip().lower() in ("value", "values"):
        rows = rows[1:]
    return [(name, value) for name, value in rows]


def _base(request: GenerateRequest) -> BaseModel:
    if _holds_saved_base(request.robot):
        if request.reading != reading() or request.derivation != {"order": Order.BASE_TO_TIP.value, "prefer": ()}:
            problem = "a saved set is used as it is, so it takes no options for reading or deriving"
            raise InputError(problem, source=str(request.robot))
        return load_base(request.robot)
    if holds_linear_model(request.robot):
        raise InputError("code is generated for robots, not for linear models", source=str(request.robot))
    return base_parameters(load(request.robot, **request.reading), **request.derivation)


def _holds_saved_base(path: Path) -> bool:
    """Whether a file says that it holds base parameters."""
    if path.suffix.lower() != ".json" or not path.is_file():
        return False
    with path.open("rb") as stream:
        return f'"{SCHEMA_NAME}"'.encode() in stream.read(4096)


def _paths(names: list[str], output: Path) -> list[Path]:
    """Where files go: into a directory, which is made, or the only one under a name of its own."""
    is_file = output.suffix and not output.is_dir()
    if is_file and len(names) == 1:
        return [output]
    folder = output.parent if is_file and output.name in names else output  # one of several that belong together
    if folder.exists() and not folder.is_dir():
        listed = ", ".join(names)
        raise InputError(f"is not a directory, and there are several files to write: {listed}", source=str(folder))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot be made: {error.strerror or error}", source=str(folder)) from None
    return [folder / name for name in names]


def _summary(base: BaseModel, source: Source, paths: list[Path], request: GenerateRequest) -> dict[str, Any]:
    functions = {
        function.name: {
            "shape": list(function.shape),
            "arguments": {argument.name: len(argument) for argument in function.arguments},
            "operations": operation_counts(function),
        }
        for function in source.functions
    }
    return {
        "schema": SUMMARY,
        "robot": base.mechanism.name,
        "target": request.options["target"],
        "precision": request.options["precision"],
        "files": [str(path) for path in paths],
        "functions": functions,
        "base_parameters": list(base.pivots),
    }
