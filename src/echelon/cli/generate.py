"""The command ``generate``.

Only click is imported here; the command imports what it needs when it runs, so that ``--help`` is instant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any, Literal

from echelon.cli.app import (
    AS_READ,
    TARGETS,
    Force,
    Ordering,
    Prefer,
    Seed,
    app,
    reading,
    reads_robot,
)
from echelon.cli.parameters import Option, Positional
from echelon.cli.screen import json_text, say_time, say_written, show, steps
from echelon.shared import CertificateError, InputError, one_line

if TYPE_CHECKING:
    from echelon.base import BaseModel
    from echelon.cli.destination import Destination
    from echelon.codegen import Source

SUMMARY = "echelon.generated/1"  # schema of the summary

FUNCTIONS = (
    "regressor, inverse_dynamics, mass_matrix, gravity, coriolis, effects, inverse_dynamics_derivatives, "
    "slotine_li, slotine_li_regressor, coriolis_matrix, momentum, momentum_regressor, momentum_bias, "
    "momentum_bias_regressor, kinetic_energy, kinetic_energy_regressor, potential_energy, "
    "potential_energy_regressor, forward_dynamics, forward_dynamics_derivatives"
)
CONTACT_FUNCTIONS = "contact_jacobian"
ONLINE = "online"
LOOP_FUNCTIONS = "closed_positions, closed_velocities, closed_accelerations, closure_pivots, constraint_forces"


@app.command(
    epilog="Example: echelon generate examples/panda.yaml --target c -o generated/"
)
@reads_robot(*AS_READ, "numeric", "mimic", "model")
def generate(
    robot: Annotated[
        Path,
        Positional(
            help="URDF, MJCF, Echelon description, or base parameters saved as JSON."
        ),
    ],
    output: Annotated[
        Path,
        Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Directory for the files, or one file.",
        ),
    ],
    read: dict[str, Any],
    force: Force = False,
    target: Annotated[
        str,
        Option(
            "--target",
            "-t",
            metavar="LANGUAGE",
            complete=TARGETS.split(", "),
            help=f"One of {TARGETS}.",
        ),
    ] = "c",
    function: Annotated[
        str | None,
        Option(
            "--function",
            show_default="regressor,inverse_dynamics,mass_matrix,gravity",
            metavar="NAMES",
            complete=FUNCTIONS.split(", "),
            help=f"One or more, with commas, of {FUNCTIONS}; with loops also of {LOOP_FUNCTIONS}; with contacts {CONTACT_FUNCTIONS}; in C {ONLINE}.",
        ),
    ] = None,
    name: Annotated[
        str | None,
        Option(
            metavar="NAME",
            help="Prefix of the functions' names; default: the robot's name.",
        ),
    ] = None,
    precision: Annotated[
        Literal["double", "single"], Option(help="Floating-point type.")
    ] = "double",
    parameters: Annotated[
        str | None,
        Option(
            metavar="VALUES",
            help="Values to write as constants: 'file' for those of the robot's file, or a JSON or CSV file.",
        ),
    ] = None,
    keep_symbols: Annotated[
        str | None,
        Option(
            metavar="NAMES",
            help="Geometry to keep as arguments instead of constants: 'all', or names with commas.",
        ),
    ] = None,
    order: Ordering = "base-to-tip",
    prefer: Prefer = None,
    seed: Seed = None,
    as_json: Annotated[
        bool, Option("--json", help="Machine-readable summary.")
    ] = False,
) -> None:
    """Write source code of the robot's functions in terms of its base parameters."""
    from echelon.cli.destination import Destination
    from echelon.codegen import FROM_FILE, generate, operations_text

    started, folder, kept = (
        perf_counter(),
        Destination(output, force),
        _names(keep_symbols or ""),
    )
    options: dict[str, Any] = {
        "target": target,
        "functions": None if function is None else _names(function),
        "name": name,
        "precision": precision,
        "keep_symbols": kept == ("all",) or kept,
    }
    derivation = {
        "order": order,
        "prefer": tuple(prefer or ()),
        **({} if seed is None else {"seed": seed}),
    }
    values = (
        parameters
        if parameters is None or parameters == FROM_FILE
        else read_values(Path(parameters))
    )
    with steps(f"generating code for {robot.name}"):
        base = _base(robot, read, derivation)
        source = generate(base, **options, parameters=values)
    paths = _written(source, folder)
    if as_json:
        show(json_text(_summary(base, source, paths, options)))
        return
    for made in source.functions:
        show(f"{made.name}: {operations_text(made)}")
    say_written(paths)
    say_time(started)


def _names(text: str) -> tuple[str, ...]:
    """Names that commas separate."""
    return tuple(part.strip() for part in text.split(",") if part.strip())


def read_values(path: Path) -> dict[str, float]:
    """Values by name, from a JSON object or from lines ``name,value``."""
    import csv

    from echelon.shared import parse_json, read_document

    text = read_document(path)
    data = parse_json(text, str(path)) if text.lstrip().startswith("{") else None
    try:
        pairs = _csv_pairs(text) if data is None else list(data.items())
        found = {
            str(name).strip(): _value(value, str(name), path) for name, value in pairs
        }
    except (ValueError, TypeError, OverflowError, csv.Error):
        raise InputError(
            'expected {"name": value, ...} or lines name,value', source=str(path)
        ) from None
    if len(found) < len(pairs):
        raise InputError("a name occurs twice", source=str(path))
    return found


def _value(value: object, name: str, path: Path) -> float:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise TypeError
    from echelon.algebra import parse_decimal

    try:
        return float(parse_decimal(str(value).strip()))
    except ValueError as error:
        raise InputError(
            str(error), source=str(path), element=f"'{one_line(name)}'"
        ) from None


def _csv_pairs(text: str) -> list[tuple[str, str]]:
    """Rows of two cells; a first row without a number is a heading."""
    import csv
    from io import StringIO

    rows = [
        row for row in csv.reader(StringIO(text)) if any(cell.strip() for cell in row)
    ]
    if rows and len(rows[0]) == 2 and rows[0][1].strip().lower() in ("value", "values"):
        rows = rows[1:]
    return [(name, value) for name, value in rows]


def _base(
    robot: Path, read: Mapping[str, Any], derivation: Mapping[str, Any]
) -> BaseModel:
    from echelon.base import base_parameters, holds_saved_base, load_base
    from echelon.dynamics import LinearModel
    from echelon.formats import load_model

    if holds_saved_base(robot):
        if read != reading() or derivation != {"order": "base-to-tip", "prefer": ()}:
            problem = "options for reading or deriving do not apply to a saved set"
            raise InputError(problem, source=str(robot))
        try:
            return load_base(robot)
        except CertificateError as error:
            raise InputError(
                f"is not a sound set: {error}", source=str(robot)
            ) from None
    model = load_model(robot, **read)
    if isinstance(model, LinearModel):
        raise InputError(
            "code is generated for robots, not for linear models", source=str(robot)
        )
    return base_parameters(model, **derivation)


def _written(files: Mapping[str, str], output: Destination) -> list[Path]:
    """Write into a directory, which is made if need be, or the only file under a name of its own."""
    path = output.path
    is_file = not path.is_dir() and (path.suffix != "" or path.exists())
    if is_file and len(files) == 1:
        output.write(*files.values())
        return [path]
    one_of_several = is_file and path.name in files
    return replace(output, path=path.parent if one_of_several else path).write_into(
        files
    )


def _summary(
    base: BaseModel, source: Source, paths: list[Path], options: Mapping[str, Any]
) -> dict[str, Any]:
    from echelon.codegen import operation_counts

    functions = {}
    for function in source.functions:
        arguments = {argument.name: len(argument) for argument in function.arguments}
        functions[function.name] = {
            "shape": list(function.shape),
            "arguments": arguments,
            "operations": operation_counts(function),
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
