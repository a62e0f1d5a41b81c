"""Entry point: commands, exit codes, and one clear line for every error.

Only typer is imported here; each command imports what it needs when it runs, so that ``--help`` is instant.
"""

from __future__ import annotations

import os
import sys
from enum import StrEnum
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

REFUTED, BAD_INPUT, INTERNAL, INTERRUPTED = 1, 2, 70, 130


class _Commands(TyperGroup):
    """The commands, which take it well when the reader of a pipe goes away (typer would exit with 1)."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except BrokenPipeError:  # nothing more can be written, not even what is still in the buffer
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit from None


app = typer.Typer(
    name="echelon",
    cls=_Commands,
    help="Exact base inertial parameters of robots, in closed form, with a certificate.",
    epilog="Exit codes: 0 success, 1 a claim was refuted, 2 bad input or usage.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


class Format(StrEnum):
    """Output formats of ``derive``."""

    TEXT = "text"
    JSON = "json"
    LATEX = "latex"
    MARKDOWN = "markdown"


class Order(StrEnum):
    """Column orders of ``derive``."""

    BASE_TO_TIP = "base-to-tip"
    TIP_TO_BASE = "tip-to-base"


class Mimic(StrEnum):
    """What to do with coupled joints."""

    COUPLED = "coupled"
    INDEPENDENT = "independent"


class Schema(StrEnum):
    """Published schemas."""

    DESCRIPTION = "description"
    BASE_MODEL = "base-model"


def _version(show: bool) -> None:
    if show:
        from echelon.version import __version__

        typer.echo(f"echelon {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    traceback: Annotated[bool, typer.Option("--traceback", help="Show the full traceback of errors.")] = False,
    _: Annotated[bool, typer.Option("--version", help="Show the version.", callback=_version)] = False,
) -> None:
    if traceback:
        os.environ["ECHELON_TRACEBACK"] = "1"


@app.command(epilog="Example: echelon derive panda.urdf --format json -o panda.json")
def derive(
    robot: Annotated[Path, typer.Argument(help="URDF, MJCF or Echelon description (YAML, JSON).")],
    output_format: Annotated[Format, typer.Option("--format", "-f", help="What to write.")] = Format.TEXT,
    as_json: Annotated[bool, typer.Option("--json", help="Short for --format json.")] = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write instead of the terminal.")
    ] = None,
    floating: Annotated[bool, typer.Option(help="Let the root link float.")] = False,
    gravity: Annotated[
        str, typer.Option(help="'file', 'none', 'generic', or three numbers or expressions: '0,0,-9.81'.")
    ] = "file",
    order: Annotated[Order, typer.Option(help="Which parameters become representatives.")] = Order.BASE_TO_TIP,
    prefer: Annotated[
        list[str] | None,
        typer.Option(help="A parameter (M7) or kind (MX) wanted as representative; may be repeated."),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(help="Read angles this near (rad) to multiples of 15° as exact; 0 switches off. [default: 0.002]"),
    ] = None,
    numeric: Annotated[bool, typer.Option("--numeric", help="Keep lengths as exact numbers.")] = False,
    mimic: Annotated[Mimic, typer.Option(help="Respect mimic joints, or treat them as independent.")] = Mimic.COUPLED,
    every_link: Annotated[bool, typer.Option("--every-link", help="Keep links fixed to others as bodies.")] = False,
    massless: Annotated[
        list[str] | None, typer.Option(help="A link that carries no parameters; may be repeated.")
    ] = None,
    structure: Annotated[bool, typer.Option("--structure", help="Count and representatives only.")] = False,
    special: Annotated[
        bool, typer.Option("--special", help="Instead: special geometry and gravity where the number changes.")
    ] = False,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the random points.")] = None,
) -> None:
    """Derive the base inertial parameters of a robot in closed form."""
    from echelon.cli.derive import DeriveRequest, run_derive

    reading = {
        "floating": floating,
        "gravity": gravity,
        "symbolic": not numeric,
        "independent_mimics": mimic is Mimic.INDEPENDENT,
        "every_link": every_link,
        "massless": tuple(massless or ()),
        **({} if tolerance is None else {"tolerance": tolerance}),
    }
    chosen = Format.JSON if as_json else output_format
    if structure and (prefer or order is not Order.BASE_TO_TIP or chosen in (Format.LATEX, Format.MARKDOWN)):
        raise typer.BadParameter("--structure is in base-to-tip order, as text or JSON, and takes no --prefer")
    if special:
        if structure or prefer or order is not Order.BASE_TO_TIP or chosen in (Format.LATEX, Format.MARKDOWN):
            raise typer.BadParameter("--special counts only: as text or JSON, without --structure, --order or --prefer")
        from echelon.cli.special import run_special

        run_special(robot, reading, output, seed, as_json=chosen is Format.JSON)
        return
    run_derive(DeriveRequest(robot, chosen.value, output, reading, order.value, tuple(prefer or ()), structure, seed))


@app.command(epilog="Example: echelon verify panda.json")
def verify(
    file: Annotated[Path, typer.Argument(help="JSON file written by 'derive --format json'.")],
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable output.")] = False,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the fresh points.")] = None,
) -> None:
    """Check a saved set of base parameters again, without trusting what it says about itself."""
    from echelon.cli.verify import run_verify

    raise typer.Exit(run_verify(file, as_json, seed))


@app.command(epilog="Example: echelon sensors arm.yaml --size 2")
def sensors(
    robot: Annotated[Path, typer.Argument(help="URDF, MJCF or Echelon description (YAML, JSON).")],
    size: Annotated[int, typer.Option(min=1, max=6, help="List all subsets up to this size.")] = 1,
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable output.")] = False,
    floating: Annotated[bool, typer.Option(help="Let the root link float.")] = False,
    gravity: Annotated[str, typer.Option(help="As for 'derive'.")] = "file",
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the random points.")] = None,
) -> None:
    """Compare what the sensors of a robot see, alone and together.

    Candidates are the outputs that the description states; without any, all actuators and a wrench sensor under the
    base.
    """
    from echelon.cli.sensors import run_sensors

    run_sensors(robot, size, {"floating": floating, "gravity": gravity}, seed, as_json=as_json)


@app.command(epilog="Example: echelon audit tx40.urdf TX40_bp_5.csv --ignore 'fv*'")
def audit(
    robot: Annotated[Path, typer.Argument(help="URDF, MJCF or Echelon description (YAML, JSON).")],
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
    floating: Annotated[bool, typer.Option(help="Let the root link float.")] = False,
    gravity: Annotated[str, typer.Option(help="As for 'derive'.")] = "file",
    tolerance: Annotated[
        float | None, typer.Option(help="As for 'derive'; 0 takes rounded angles literally, as most programs do.")
    ] = None,
    mimic: Annotated[Mimic, typer.Option(help="Respect mimic joints, or treat them as independent.")] = Mimic.COUPLED,
    every_link: Annotated[bool, typer.Option("--every-link", help="Keep links fixed to others as bodies.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable output.")] = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write instead of the terminal.")
    ] = None,
) -> None:
    """Compare base parameters that someone else claims with the exact ones; exits with 1 where they differ."""
    from echelon.cli.audit import run_audit

    reading = {
        "floating": floating,
        "gravity": gravity,
        "independent_mimics": mimic is Mimic.INDEPENDENT,
        "every_link": every_link,
        **({} if tolerance is None else {"tolerance": tolerance}),
    }
    raise typer.Exit(run_audit(robot, claimed, reading, naming, define or (), ignore or (), as_json, output))


@app.command(epilog="Example: echelon schema description > robot.schema.json")
def schema(which: Annotated[Schema, typer.Argument(help="Which schema to print.")]) -> None:
    """Print the JSON schema of a file format."""
    import json

    if which is Schema.DESCRIPTION:
        from echelon.formats.schema import json_schema
    else:
        from echelon.results.record import json_schema
    typer.echo(json.dumps(json_schema(), indent=2))


def main() -> None:
    """Run the command line and exit with its code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # files and pipes get UTF-8 on every system
            stream.reconfigure(errors="replace") if stream.isatty() else stream.reconfigure(encoding="utf-8")
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except Exception as error:
        sys.exit(_report(error))


def _report(error: Exception) -> int:
    """One line for what a user can mend, a traceback for our own mistakes or on request; returns the exit code."""
    from traceback import print_exception

    from echelon.errors import EchelonError, one_line

    expected = isinstance(error, EchelonError | OSError)
    if expected and not os.environ.get("ECHELON_TRACEBACK"):
        print(f"echelon: {one_line(str(error))}", file=sys.stderr)  # noqa: T201
    else:
        print_exception(error)
    return BAD_INPUT if expected else INTERNAL
