"""Commands about robots, their base parameters and measured logs; exit codes, and one clear line for every error.

Only click is imported here; each command imports what it needs when it runs, so that ``--help`` is instant.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import click

from echelon.cli.app import (
    AS_READ,
    TARGETS,
    AsJson,
    Budget,
    Force,
    Ordering,
    Output,
    Prefer,
    Robot,
    Seed,
    app,
    reads_robot,
)
from echelon.cli.parameters import Option, Positional
from echelon.cli.process import Exit
from echelon.cli.screen import json_text, show
from echelon.compute import VARIABLES
from echelon.shared import Estimator, InputError, ValuesToUse, one_line

__all__ = ["app", "run"]

Format = Literal["text", "json", "latex", "markdown"]
Formulas = Literal["latex", "sympy"]


@app.command(epilog="Example: echelon derive examples/panda.yaml --json -o panda.json")
@reads_robot(*AS_READ, "numeric", "mimic", "symbols", "measured", "model")
def derive(
    robot: Robot,
    read: dict[str, Any],
    output_format: Annotated[
        Format, Option("--format", "-f", help="What to write.")
    ] = "text",
    as_json: Annotated[bool, Option("--json", help="Short for --format json.")] = False,
    output: Output = None,
    force: Force = False,
    order: Ordering = "base-to-tip",
    prefer: Prefer = None,
    generic: Annotated[
        bool,
        Option(
            "--generic",
            help="Answer for general values of the symbols, not for the robot's own.",
        ),
    ] = False,
    rank_only: Annotated[
        bool,
        Option("--rank-only", help="Print only the rank and representatives."),
    ] = False,
    special: Annotated[
        bool,
        Option(
            "--special",
            help="Print the special geometries and directions of gravity that change the number.",
        ),
    ] = False,
    compare_numeric: Annotated[
        bool,
        Option(
            "--compare-numeric",
            help="Print the ranks of SVD and QR beside the exact one.",
        ),
    ] = False,
    regressor: Annotated[
        Formulas | None,
        Option("--regressor", help="Print the base regressor as formulas."),
    ] = None,
    full: Annotated[
        bool,
        Option(
            "--full",
            help="Print every formula; those of more than 12 terms are numbers otherwise.",
        ),
    ] = False,
    seed: Seed = None,
    budget: Budget = 1.0,
) -> None:
    """Derive the base inertial parameters of a robot in closed form."""
    chosen: Format = "json" if as_json else output_format
    instead = {
        "--rank-only": rank_only,
        "--special": special,
        "--compare-numeric": compare_numeric,
    }
    asked = [
        name
        for name, wanted in {**instead, "--regressor": regressor is not None}.items()
        if wanted
    ]
    if len(asked) > 1:
        raise click.BadParameter(
            f"{' and '.join(asked)} cannot be combined: each prints its own answer"
        )
    if regressor is not None and chosen != "text":
        raise click.BadParameter("--regressor prints formulas and takes no --format")
    ordered = prefer or order != "base-to-tip"
    if asked and regressor is None and (ordered or chosen in ("latex", "markdown")):
        raise click.BadParameter(
            f"{asked[0]} prints numbers; it takes no --order, --prefer, LaTeX or Markdown"
        )

    from echelon.algebra import DEFAULT_SEED
    from echelon.cli import derive
    from echelon.cli.destination import output_file

    target, seed = output_file(output, force), DEFAULT_SEED if seed is None else seed
    derivation = {"order": order, "prefer": tuple(prefer or ()), "generic": generic}
    if compare_numeric:
        derive.run_compare_numeric(robot, read, target, seed, as_json=chosen == "json")
    elif special:
        derive.run_special(robot, read, target, seed, as_json=chosen == "json")
    elif rank_only:
        derive.run_rank_only(
            robot, read, target, seed, generic=generic, as_json=chosen == "json"
        )
    else:
        derive.run_derive(
            robot, chosen, regressor, read, derivation, target, seed, budget, full=full
        )


@app.command(epilog="Example: echelon sensors examples/double_pendulum.yaml --size 2")
@reads_robot("floating", "gravity", "ignore", "model")
def sensors(
    robot: Robot,
    read: dict[str, Any],
    size: Annotated[
        int, Option(min=1, max=6, help="List all subsets up to this size.")
    ] = 1,
    as_json: AsJson = False,
    seed: Seed = None,
    budget: Budget = 1.0,
) -> None:
    """Compare what the sensors of a robot see, alone and together.

    Candidates are the outputs that the description states; without any, all actuators and a wrench sensor under the
    base.
    """
    from echelon.algebra import DEFAULT_SEED
    from echelon.cli.derive import run_sensors

    run_sensors(
        robot,
        size,
        read,
        DEFAULT_SEED if seed is None else seed,
        budget,
        as_json=as_json,
    )


@app.command(
    epilog="Example: echelon setup examples/panda.yaml examples/data/panda_30hz/panda_exciting.parquet -o setup.yaml"
)
def setup(
    robot: Annotated[
        Path,
        Positional(help="URDF, SDF, MJCF, or a description without the section log."),
    ],
    logs: Annotated[
        list[Path],
        Positional(help="One log, or several files of one log with a common clock."),
    ],
    output: Output = None,
    force: Force = False,
) -> None:
    """Write a commented set-up for a robot and a log: columns, clock, units and effects.

    The command tries the set-up on the log, and writes open questions as comments.
    """
    from echelon.cli.destination import output_file
    from echelon.cli.identify import run_setup

    run_setup(robot, logs, output_file(output, force))


@app.command(
    epilog="Example: echelon identify examples/logs/panda_30hz.yaml examples/data/panda_30hz/panda_exciting.parquet -o result/"
)
@reads_robot(*AS_READ, "model")
def identify(
    setup: Annotated[
        Path,
        Positional(
            help="Robot description with its measurement set-up; or URDF, MJCF."
        ),
    ],
    logs: Annotated[
        list[Path],
        Positional(
            help="CSV, Parquet, NPZ, MAT, HDF5, ROS bag or MCAP; a directory stands for all logs in it."
        ),
    ],
    read: dict[str, Any],
    validate: Annotated[
        list[Path] | None,
        Option("--validate", help="A log for validation only; may be repeated."),
    ] = None,
    output: Annotated[
        Path | None,
        Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Directory for model, report, robot file and code.",
        ),
    ] = None,
    force: Force = False,
    prior: Annotated[
        Path | None,
        Option(
            help="The same robot with prior inertial values (URDF, MJCF, description)."
        ),
    ] = None,
    estimator: Annotated[
        Estimator | None, Option(help="Estimator, instead of the set-up's.")
    ] = None,
    predict_with: Annotated[
        ValuesToUse | None,
        Option(help="Values that predictions use, instead of the set-up's."),
    ] = None,
    holdout: Annotated[
        float | None,
        Option(
            min=0,
            max=0.9,
            help="Share held out without --validate: the end of a single log, the last of several logs.",
        ),
    ] = None,
    physical: Annotated[
        bool | None,
        Option(
            "--physical/--no-physical",
            help="Fit a physically consistent robot as well.",
        ),
    ] = None,
    target: Annotated[
        str,
        Option(
            "--target",
            "-t",
            metavar="LANGUAGE",
            complete=[*TARGETS.split(", "), "none"],
            help="Language of the model's source, as for generate; or none.",
        ),
    ] = "c",
    dask: Annotated[
        str | None,
        Option(
            metavar="ADDRESS",
            help="Address of a Dask scheduler, or a number of processes to start here.",
        ),
    ] = None,
    check: Annotated[
        bool,
        Option(
            "--check",
            help="Exit with 1, and print the reasons, if the verdict is not to use the model.",
        ),
    ] = False,
    seed: Seed = None,
    as_json: AsJson = False,
) -> None:
    """Fit a robot's parameters to logs, validate the model on data it did not see, and write it.

    With -o: model.json, report.html, the robot with identified inertials, and source code of the fitted model.
    """
    from echelon.cli.destination import Destination
    from echelon.cli.identify import run_identify

    changed = {
        "estimator": estimator,
        "predict": predict_with,
        "holdout": holdout,
        "physical": physical,
        "seed": seed,
    }
    stated = {name: value for name, value in changed.items() if value is not None}
    folder = None if output is None else Destination(output, force)
    reasons = run_identify(
        setup,
        logs,
        validate or (),
        folder,
        prior,
        stated,
        read,
        target,
        dask,
        as_json=as_json,
    )
    if check and reasons:
        for reason in reasons:
            click.echo(f"echelon: do not use the model: {one_line(reason)}", err=True)
        raise click.exceptions.Exit(1)


@app.command(
    epilog="Example: echelon check examples/logs/panda_30hz.yaml examples/data/panda_30hz/panda_exciting.parquet"
)
@reads_robot(*AS_READ, "model")
def check(
    setup: Annotated[
        Path,
        Positional(
            help="Robot description with its measurement set-up; or URDF, MJCF."
        ),
    ],
    logs: Annotated[
        list[Path], Positional(help="Logs; a directory stands for all logs in it.")
    ],
    read: dict[str, Any],
    as_json: AsJson = False,
) -> None:
    """Report what logs can show of a robot and what is missing, before anything is fitted."""
    from echelon.cli.identify import run_check

    run_check(setup, logs, read, as_json=as_json)


@app.command(
    epilog="Example: echelon predict result/model.json examples/data/panda_30hz/panda_exciting.parquet -o predicted.csv"
)
def predict(
    model: Annotated[
        Path, Positional(help="model.json that 'echelon identify' wrote.")
    ],
    log: Annotated[
        Path,
        Positional(help="A log of positions; outputs are compared where it has them."),
    ],
    output: Annotated[
        Path | None,
        Option(
            "--output",
            "-o",
            help="CSV or Parquet file with time, predicted and measured.",
        ),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Predict the outputs of a log with an identified model."""
    from echelon.cli.destination import output_file
    from echelon.cli.identify import run_predict

    run_predict(model, log, output_file(output, force), as_json=as_json)


Schema = Literal[
    "description",
    "base-model",
    "linear-base",
    "identified",
    "trajectory",
    "comparison",
    "calibration",
]


@app.command(epilog="Example: echelon verify panda.json")
def verify(
    file: Annotated[
        Path, Positional(help="JSON file written by 'derive --format json'.")
    ],
    as_json: AsJson = False,
    seed: Seed = None,
) -> None:
    """Check a saved set of base parameters again, without trusting its own statements.

    Exit codes: 0 valid, 1 not valid, 2 not readable, 3 checked in part only.
    """
    from echelon.cli.verify import run_verify

    raise click.exceptions.Exit(run_verify(file, seed, as_json=as_json))


@app.command(
    epilog="Example: echelon audit examples/double_pendulum.yaml docs/examples/pendulum_claims.txt"
)
@reads_robot(
    "floating", "gravity", "snap_tolerance", "mimic", "keep_fixed_links", "model"
)
def audit(
    robot: Robot,
    claimed: Annotated[
        Path,
        Positional(
            help="Base parameters to check: CSV, JSON, or text as papers print it."
        ),
    ],
    read: dict[str, Any],
    naming: Annotated[
        str,
        Option(
            metavar="NAMES",
            help="How the claims write parameters: 'auto', or echelon, symoro, sympybotics, pinocchio.",
        ),
    ] = "auto",
    define: Annotated[
        list[str] | None,
        Option(
            metavar="NAME=EXPRESSION",
            help="Meaning of a symbol in the claims, 'RL4=pz4' or 'L=0.45'; may be repeated.",
        ),
    ] = None,
    ignore: Annotated[
        list[str] | None,
        Option(
            metavar="PATTERN",
            help="Parameters of the claims that the robot file lacks, 'fv*'; may be repeated.",
        ),
    ] = None,
    as_json: AsJson = False,
    output: Output = None,
    force: Force = False,
) -> None:
    """Compare claimed base parameters with the exact ones; exit code 1 if they differ."""
    from echelon.base import audit
    from echelon.cli.destination import deliver, output_file
    from echelon.formats import load

    target, defined = output_file(output, force), _definitions(define or ())
    found = audit(
        load(robot, **read),
        claimed,
        naming=naming,
        define=defined,
        ignore=tuple(ignore or ()),
    )
    deliver(json_text(found.to_dict()) if as_json else found.to_text(), target)
    raise click.exceptions.Exit(Exit.VALID if found.equal else Exit.REFUTED)


def _definitions(texts: Sequence[str]) -> dict[str, str]:
    """Symbols of the claims by name, from texts ``NAME=EXPRESSION``."""
    parts = [text.partition("=") for text in texts]
    for text, (name, _, value) in zip(texts, parts, strict=True):
        if not name.strip().isidentifier() or not value.strip():
            raise InputError(
                f"--define takes NAME=EXPRESSION, such as RL4=pz4 or L=0.45, not '{text}'"
            )
    return {name.strip(): value.strip() for name, _, value in parts}


@app.command(
    epilog="Example: echelon compare examples/so101.urdf docs/examples/so101_cad.urdf --velocity 3"
)
@reads_robot(
    "floating",
    "gravity",
    "snap_tolerance",
    "mimic",
    "keep_fixed_links",
    "massless",
    "ignore",
    "model",
)
def compare(
    first: Robot,
    second: Annotated[Path, Positional(help="A robot with the same joints.")],
    read: dict[str, Any],
    tolerance: Annotated[
        float | None,
        Option(
            min=0,
            help="Largest difference of outputs that counts as zero, N·m or N; default: the effect of the files' last decimals.",
        ),
    ] = None,
    velocity: Annotated[
        float | None,
        Option(min=0, help="Largest speed of all joints, rad/s or m/s."),
    ] = None,
    acceleration: Annotated[
        float | None,
        Option(min=0, help="Largest acceleration of all joints, rad/s² or m/s²."),
    ] = None,
    lock: Annotated[
        list[str] | None,
        Option(
            metavar="NAME=POSITION",
            help="A joint to hold, such as finger=0, in each robot that has it; may be repeated.",
        ),
    ] = None,
    as_json: AsJson = False,
    output: Output = None,
    force: Force = False,
) -> None:
    """Compare two robots by what their sensors see: geometry, base parameters, and outputs within limits of the motion.

    Exit codes: 0 equal, 1 different, 2 not readable or not comparable, 3 undecided.
    """
    from echelon.cli.compare import run_compare
    from echelon.cli.destination import output_file

    stated = {"velocity": velocity, "acceleration": acceleration}
    limits = {name: value for name, value in stated.items() if value is not None}
    target = output_file(output, force)
    options = {"tolerance": tolerance, "limits": limits, "locked": _held(lock or ())}
    raise click.exceptions.Exit(
        run_compare(first, second, read, options, target, as_json=as_json)
    )


def _held(texts: Sequence[str]) -> dict[str, float]:
    """Positions of joints by name, from texts ``NAME=POSITION``."""
    found = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            raise InputError(
                f"--lock takes NAME=POSITION, such as finger=0.02, not '{text}'"
            ) from None
    return found


@app.command(epilog="Example: echelon schema description > robot.schema.json")
def schema(
    which: Annotated[
        Schema,
        Positional(metavar="FORMAT", help=f"One of {', '.join(get_args(Schema))}."),
    ],
) -> None:
    """Print the JSON schema of a file format."""
    from echelon.base import BaseModelRecord, LinearBaseRecord
    from echelon.identification import IdentifiedRecord
    from echelon.shared import file_schema

    if which == "description":
        from echelon.formats import (
            json_schema as description_schema,
        )

        found = description_schema()
    elif which == "trajectory":
        from echelon.excite import trajectory_schema

        found = trajectory_schema()
    elif which == "comparison":
        from echelon.comparison import comparison_schema

        found = comparison_schema()
    elif which == "calibration":
        from echelon.calibration import calibration_schema

        found = calibration_schema()
    else:
        records: dict[str, Any] = {
            "base-model": BaseModelRecord,
            "linear-base": LinearBaseRecord,
            "identified": IdentifiedRecord,
        }
        found = file_schema(records[which])
    show(json.dumps(found, indent=2))


from echelon.cli import calibrate, excite_commands, generate  # noqa: E402, F401  their commands follow in the help


def run() -> None:
    """Run the command that the arguments name, and exit with its code."""
    os.environ |= dict.fromkeys(
        VARIABLES, "1"
    )  # before NumPy is imported; equal commands write equal bytes
    try:
        code = app.main(standalone_mode=False)
    except click.ClickException as error:
        error.show()
        code = error.exit_code
    except (KeyboardInterrupt, click.Abort):
        code = Exit.INTERRUPTED
    except Exception as error:
        code = _report(error)
    sys.exit(code)


def _report(error: Exception) -> int:
    """One line for what a user can mend, a traceback for our own mistakes or on request; returns the exit code."""
    from traceback import print_exception

    from echelon.shared import EchelonError

    expected = isinstance(error, EchelonError | OSError)
    if expected and not os.environ.get("ECHELON_TRACEBACK"):
        print(f"echelon: {one_line(str(error))}", file=sys.stderr)  # noqa: T201
    else:
        print_exception(error)
    return Exit.BAD_INPUT if expected else Exit.INTERNAL
