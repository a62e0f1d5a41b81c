"""The ``generate`` command."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import replace
from io import StringIO
from pathlib import Path
from time import perf_counter
from typing import Any

from echelon.base.derive import base_parameters
from echelon.base.model import BaseModel
from echelon.cli.app import reading
from echelon.cli.destination import Destination
from echelon.cli.screen import json_text, say_time, say_written, show, steps
from echelon.codegen import FROM_FILE, Source, generate_source, operation_counts, operations_text
from echelon.errors import CertificateError, InputError, one_line
from echelon.exact.numbers import parse_decimal
from echelon.formats.robot_file import load_model
from echelon.inputs.content import read_document
from echelon.inputs.json_text import parse_json
from echelon.models.linear_model import LinearModel
from echelon.results.saved import load_base
from echelon.results.schema import SCHEMA_NAME

SUMMARY = "echelon.generated/1"
"""Schema of the summary."""


def run_generate(
    robot: Path,
    output: Destination,
    read: Mapping[str, Any],
    derivation: Mapping[str, Any],
    options: Mapping[str, Any],
    parameters: str | None,
    *,
    as_json: bool,
) -> None:
    """Generate, write all files, and say what was written."""
    started = perf_counter()
    values = parameters if parameters is None or parameters == FROM_FILE else read_values(Path(parameters))
    with steps(f"generating code for {robot.name}"):
        base = _base(robot, read, derivation)
        source = generate_source(base, **options, parameters=values)
    paths = _written(source.files, output)
    if as_json:
        show(json_text(_summary(base, source, paths, options)))
        return
    for function in source.functions:
        show(f"{function.name}: {operations_text(function)}")
    say_written(paths)
    say_time(started)


def read_values(path: Path) -> dict[str, float]:
    """Values by name, from a JSON object or from lines ``name,value``."""
    text = read_document(path)
    data = parse_json(text, str(path)) if text.lstrip().startswith("{") else None
    try:
        pairs = _csv_pairs(text) if data is None else list(data.items())
        found = {str(name).strip(): _value(value, str(name), path) for name, value in pairs}
    except (ValueError, TypeError, OverflowError, csv.Error):
        raise InputError('expected {"name": value, ...} or lines name,value', source=str(path)) from None
    if len(found) < len(pairs):
        raise InputError("a name occurs twice", source=str(path))
    return found


def _value(value: object, name: str, path: Path) -> float:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise TypeError
    try:
        return float(parse_decimal(str(value).strip()))
    except ValueError as error:
        raise InputError(str(error), source=str(path), element=f"'{one_line(name)}'") from None


def _csv_pairs(text: str) -> list[tuple[str, str]]:
    """Rows of two cells; a first row without a number is a heading."""
    rows = [row for row in csv.reader(StringIO(text)) if any(cell.strip() for cell in row)]
    if rows and len(rows[0]) == 2 and rows[0][1].strip().lower() in ("value", "values"):
        rows = rows[1:]
    return [(name, value) for name, value in rows]


def _base(robot: Path, read: Mapping[str, Any], derivation: Mapping[str, Any]) -> BaseModel:
    if _holds_saved_base(robot):
        if read != reading() or derivation != {"order": "base-to-tip", "prefer": ()}:
            problem = "a saved set is used as it is, so it takes no options for reading or deriving"
            raise InputError(problem, source=str(robot))
        try:
            return load_base(robot)
        except CertificateError as error:
            raise InputError(f"is not a sound set: {error}", source=str(robot)) from None
    model = load_model(robot, **read)
    if isinstance(model, LinearModel):
        raise InputError("code is generated for robots, not for linear models", source=str(robot))
    return base_parameters(model, **derivation)


def _holds_saved_base(path: Path) -> bool:
    """Whether a file says that it holds base parameters."""
    if path.suffix.lower() != ".json" or not path.is_file():
        return False
    with path.open("rb") as stream:
        return f'"{SCHEMA_NAME}"'.encode() in stream.read(4096)


def _written(files: Mapping[str, str], output: Destination) -> list[Path]:
    """Write into a directory, which is made if need be, or the only file under a name of its own."""
    path = output.path
    is_file = not path.is_dir() and (path.suffix != "" or path.exists())
    if is_file and len(files) == 1:
        output.write(*files.values())
        return [path]
    one_of_several = is_file and path.name in files
    return replace(output, path=path.parent if one_of_several else path).write_into(files)


def _summary(base: BaseModel, source: Source, paths: list[Path], options: Mapping[str, Any]) -> dict[str, Any]:
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
        "target": options["target"],
        "precision": options["precision"],
        "files": [str(path) for path in paths],
        "functions": functions,
        "base_parameters": list(base.pivots),
    }
