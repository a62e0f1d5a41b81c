"""Commands about robots and their base parameters.

Only typer is imported here; each command imports what it needs when it runs, so that ``--help`` is instant.
"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from echelon.cli.app import app
from echelon.cli.options import (
    AsJson,
    Budget,
    EveryLink,
    Floating,
    Force,
    Gravity,
    Massless,
    Measured,
    Measuring,
    Mimic,
    Mimicking,
    Numeric,
    Order,
    Ordering,
    Output,
    Prefer,
    Robot,
    Seed,
    Symbols,
    SymbolSharing,
    Tolerance,
    reading,
)
from echelon.cli.show import show

TARGETS = "c, cpp, cuda, python, jax, casadi, matlab, julia, rust"
FUNCTIONS = "regressor, inverse_dynamics, mass_matrix, gravity, coriolis, effects, inverse_dynamics_derivatives"
LOOP_FUNCTIONS = "closed_positions, closed_velocities, closed_accelerations, closure_pivots, constraint_forces"


class Format(StrEnum):
    """Output formats of ``derive``."""

    TEXT = "text"
    JSON = "json"
    LATEX = "latex"
    MARKDOWN = "markdown"


class Formulas(StrEnum):
    """Languages of ``derive --regressor``."""

    LATEX = "latex"
    SYMPY = "sympy"


class Schema(StrEnum):
    """Published schemas."""

    DESCRIPTION = "description"
    BASE_MODEL = "base-model"
    IDENTIFIED = "identified"
    TRAJECTORY = "trajectory"


@app.command(epilog="Example: echelon derive panda.urdf --format json -o panda.json")
def derive(
    robot: Robot,
    output_format: Annotated[Format, typer.Option("--format", "-f", help="What to write.")] = Format.TEXT,
    as_json: Annotated[bool, typer.Option("--json", help="Short for --format json.")] = False,
    output: Output = None,
    force: Force = False,
    floating: Floating = False,
    gravity: Gravity = "file",
    order: Ordering = Order.BASE_TO_TIP,
    prefer: Prefer = None,
    tolerance: Tolerance = None,
    numeric: Numeric = False,
    mimic: Mimicking = Mimic.COUPLED,
    every_link: EveryLink = False,
    massless: Massless = None,
    symbols: Symbols = SymbolSharing.SHARED,
    generic: Annotated[
        bool, typer.Option("--generic", help="Answer for general values of the symbols, not for the stated ones.")
    ] = False,
    measured: Measuring = Measured.DRIVES,
    structure: Annotated[bool, typer.Option("--structure", help="Count and representatives only.")] = False,
    special: Annotated[
        bool, typer.Option("--special", help="Instead: special geometry and gravity where the number changes.")
    ] = False,
    compare_numeric: Annotated[
        bool, typer.Option("--compare-numeric", help="Instead: what SVD and QR would have counted, beside the truth.")
    ] = False,
    regressor: Annotated[
        Formulas | None, typer.Option("--regressor", help="Instead: the base regressor as formulas.")
    ] = None,
    seed: Seed = None,
    budget: Budget = 1.0,
) -> None:
    """Derive the base inertial parameters of a robot in closed form."""
    from echelon.cli.derive import DeriveRequest, run_derive
    from echelon.cli.destination import output_file

    target = output_file(output, force)
    chosen_reading = reading(floating, gravity, tolerance, mimic, every_link, numeric, massless, symbols, measured)
    chosen = Format.JSON if as_json else output_format
    if structure and (prefer or order is not Order.BASE_TO_TIP or chosen in (Format.LATEX, Format.MARKDOWN)):
        raise typer.BadParameter("--structure is in base-to-tip order, as text or JSON, and takes no --prefer")
    if regressor is not None:
        if structure or special or compare_numeric or chosen is not Format.TEXT:
            raise typer.BadParameter("--regressor prints formulas: without --format or other choices of what to print")
        from echelon.cli.derive_regressor import run_regressor

        formulas = regressor.value
        run_regressor(robot, formulas, chosen_reading, order.value, tuple(prefer or ()), target, seed)
        return
    if compare_numeric:
        if (
            structure
            or special
            or prefer
            or order is not Order.BASE_TO_TIP
            or chosen in (Format.LATEX, Format.MARKDOWN)
        ):
            raise typer.BadParameter("--compare-numeric counts only: as text or JSON, without other choices")
        from echelon.cli.compare_numeric import run_compare_numeric

        run_compare_numeric(robot, chosen_reading, target, seed, as_json=chosen is Format.JSON)
        return
    if special:
        if structure or prefer or order is not Order.BASE_TO_TIP or chosen in (Format.LATEX, Format.MARKDOWN):
            raise typer.BadParameter("--special counts only: as text or JSON, without --structure, --order or --prefer")
        from echelon.cli.special import run_special

        run_special(robot, chosen_reading, target, seed, as_json=chosen is Format.JSON)
        return
    preferred = tuple(prefer or ())
    run_derive(
        DeriveRequest(
            robot, chosen.value, target, chosen_reading, order.value, preferred, structure, generic, seed, budget
        )
    )


@app.command(epilog="Example: echelon generate panda.urdf --target c -o generated/")
def generate(
    robot: Annotated[Path, typer.Argument(help="URDF, MJCF, Echelon description, or base parameters saved as JSON.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Directory for the files, or one file.")],
    force: Force = False,
    target: Annotated[str, typer.Option("--target", "-t", help=f"One of {TARGETS}.")] = "c",
    function: Annotated[
        str | None,
        typer.Option(
            "--function",
            show_default="regressor,inverse_dynamics,mass_matrix,gravity",
            help=f"One or more, with commas, of {FUNCTIONS}; with loops also of {LOOP_FUNCTIONS}.",
        ),
    ] = None,
    name: Annotated[str | None, typer.Option(help="Stands before the functions' names; made from the robot's.")] = None,
    precision: Annotated[str, typer.Option(help="double or single.")] = "double",
    parameters: Annotated[
        str | None,
        typer.Option(
            help="Values to put in as constants: 'file' for those of the robot's file, or a JSON or CSV file."
        ),
    ] = None,
    keep_symbols: Annotated[
        str | None,
        typer.Option(help="Geometry that becomes an argument instead of constants: 'all', or names with commas."),
    ] = None,
    floating: Floating = False,
    gravity: Gravity = "file",
    order: Ordering = Order.BASE_TO_TIP,
    prefer: Prefer = None,
    tolerance: Tolerance = None,
    numeric: Numeric = False,
    mimic: Mimicking = Mimic.COUPLED,
    every_link: EveryLink = False,
    massless: Massless = None,
    seed: Seed = None,
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable summary.")] = False,
) -> None:
    """Write source code of the robot's functions in terms of its base parameters."""
    from echelon.cli.destination import output_folder
    from echelon.cli.generate import GenerateRequest, run_generate

    chosen_reading = reading(floating, gravity, tolerance, mimic, every_link, numeric, massless)
    functions = None if function is None else tuple(part.strip() for part in function.split(",") if part.strip())
    kept = tuple(part.strip() for part in (keep_symbols or "").split(",") if part.strip())
    derivation = {"order": order.value, "prefer": tuple(prefer or ()), **({} if seed is None else {"seed": seed})}
    options = {"target": target, "functions": functions, "name": name, "precision": precision}
    keeping = {"keep_symbols": kept == ("all",) or kept}
    run_generate(
        GenerateRequest(robot, output_folder(output, force), chosen_reading, derivation, options | keeping, parameters),
        as_json=as_json,
    )


@app.command(epilog="Example: echelon verify panda.json")
def verify(
    file: Annotated[Path, typer.Argument(help="JSON file written by 'derive --format json'.")],
    as_json: AsJson = False,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the fresh points.")] = None,
) -> None:
    """Check a saved set of base parameters again, without trusting what it says about itself."""
    from echelon.cli.verify import run_verify

    raise typer.Exit(run_verify(file, as_json, seed))


@app.command(epilog="Example: echelon sensors arm.yaml --size 2")
def sensors(
    robot: Robot,
    size: Annotated[int, typer.Option(min=1, max=6, help="List all subsets up to this size.")] = 1,
    as_json: AsJson = False,
    floating: Floating = False,
    gravity: Gravity = "file",
    seed: Seed = None,
    budget: Annotated[float, typer.Option(min=0, help="How much work subsets may take: 1 is a few seconds.")] = 1.0,
) -> None:
    """Compare what the sensors of a robot see, alone and together.

    Candidates are the outputs that the description states; without any, all actuators and a wrench sensor under the
    base.
    """
    from echelon.cli.sensors import run_sensors

    run_sensors(robot, size, {"floating": floating, "gravity": gravity}, seed, budget, as_json=as_json)


@app.command(epilog="Example: echelon audit tx40.urdf TX40_bp_5.csv --ignore 'fv*'")
def audit(
    robot: Robot,
    claimed: Annotated[Path, typer.Argument(help="Base parameters to check: CSV, JSON, or one expression per line.")],
    naming: Annotated[
        str, typer.Option(help="How the claims write parameters: 'auto', or echelon, symoro, sympybotics, pinocchio.")
    ] = "auto",
    define: Annotated[
        list[str] | None, typer.Option(help="A symbol of the claims, 'RL4=pz4' or 'L=0.45'; may be repeated.")
    ] = None,
    ignore: Annotated[
        list[str] | None, typer.Option(help="Parameters that the robot file leaves out, 'fv*'; may be repeated.")
    ] = None,
    floating: Floating = False,
    gravity: Gravity = "file",
    tolerance: Tolerance = None,
    mimic: Mimicking = Mimic.COUPLED,
    every_link: EveryLink = False,
    as_json: AsJson = False,
    output: Output = None,
    force: Force = False,
) -> None:
    """Compare base parameters that someone else claims with the exact ones; exits with 1 where they differ."""
    from echelon.cli.audit import run_audit
    from echelon.cli.destination import output_file

    target = output_file(output, force)
    chosen_reading = reading(floating, gravity, tolerance, mimic, every_link)
    raise typer.Exit(run_audit(robot, claimed, chosen_reading, naming, define or (), ignore or (), as_json, target))


@app.command(epilog="Example: echelon schema description > robot.schema.json")
def schema(which: Annotated[Schema, typer.Argument(help="Which schema to print.")]) -> None:
    """Print the JSON schema of a file format."""
    import json

    if which is Schema.DESCRIPTION:
        from echelon.formats.schema import json_schema
    elif which is Schema.IDENTIFIED:
        from echelon.results.identified_record import json_schema
    elif which is Schema.TRAJECTORY:
        from echelon.excite.files.trajectory_schema import trajectory_schema as json_schema
    else:
        from echelon.results.record import json_schema
    show(json.dumps(json_schema(), indent=2))
