"""The command ``calibrate``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any

from echelon.cli.app import AsJson, Force, Seed, app, reads_robot
from echelon.cli.parameters import Option, Positional
from echelon.cli.screen import json_text, say_time, say_written, show, steps
from echelon.shared import CalibrationErrors, InputError, one_line

if TYPE_CHECKING:
    from echelon.calibration import Calibration

CALIBRATION, REPORT = "calibration.json", "calibration.html"


@app.command(
    epilog="Example: echelon calibrate examples/calibration/arm.yaml examples/calibration/tracker.csv -o calibrated/"
)
@reads_robot("snap_tolerance", "ignore", "model")
def calibrate(
    robot: Annotated[
        Path,
        Positional(
            help="Robot description with the section 'measure'; or URDF, SDF, MJCF for poses of the last body."
        ),
    ],
    read: dict[str, Any],
    logs: Annotated[
        list[Path] | None,
        Positional(
            help="Logs of poses: joint positions and measurements. Without a log, the command derives which errors "
            "such measurements show."
        ),
    ] = None,
    errors: Annotated[
        str,
        Option(
            metavar="KINDS",
            help="Errors to find, with commas between: frames, modified_dh, standard_dh, offsets, gears, "
            "stiffness.",
        ),
    ] = "frames",
    output: Annotated[
        Path | None,
        Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Directory for calibration.json, calibration.html and the calibrated robot.",
        ),
    ] = None,
    force: Force = False,
    seed: Seed = None,
    as_json: AsJson = False,
) -> None:
    """Calibrate a robot's geometry by measured poses, points, distances or contacts, and write the calibrated robot.

    Every second row is held out from a first fit, which these rows judge; the values are then fitted to all rows.
    """
    from echelon.algebra import DEFAULT_SEED
    from echelon.base import to_json, to_text
    from echelon.calibration import calibrate as run
    from echelon.calibration import calibration_base, calibration_document
    from echelon.cli.destination import Destination
    from echelon.identification import load_setup

    started, chosen = perf_counter(), _chosen(errors)
    target = None if output is None else Destination(output, force)
    if target is not None:
        target.check((CALIBRATION, REPORT))
    if target is not None and not logs:
        raise InputError(
            "-o needs a log: name one, or leave out -o to see only which errors the measurements show"
        )
    setup, seed = load_setup(robot, **read), DEFAULT_SEED if seed is None else seed
    if not logs:
        with steps("deriving which errors the measurements show"):
            base = calibration_base(setup, errors=chosen, seed=seed)
        show(to_json(base) if as_json else to_text(base))
        return
    with steps() as step:
        found = run(setup, logs, errors=chosen, seed=seed, on_step=step)
        files = {} if target is None else _files(found)
    paths = [] if target is None else target.write_into(files)
    if as_json:
        show(
            json_text(
                {**calibration_document(found), "files": [str(path) for path in paths]}
            )
        )
        return
    for line in lines(found):
        show(one_line(line))
    say_written(paths)
    say_time(started)


def _chosen(text: str) -> tuple[CalibrationErrors, ...]:
    """Kinds of errors from a text with commas."""
    from typing import get_args

    from echelon.shared import nearest_of

    found = tuple(part.strip() for part in text.split(","))
    valid = get_args(CalibrationErrors)
    for part in found:
        if part not in valid:
            raise InputError(f"there are no errors '{part}'{nearest_of(part, valid)}")
    return found  # type: ignore[return-value]


def _files(found: Calibration) -> dict[str, str]:
    from echelon.calibration import calibration_document
    from echelon.report import calibration_html

    return {
        CALIBRATION: json_text(calibration_document(found)),
        REPORT: calibration_html(found),
        found.written.name: found.written.text,
    }


def lines(found: Calibration) -> Sequence[str]:
    """The summary of a calibration."""
    from math import degrees

    base = found.base
    shown = [
        f"{base.model.name}: {base.rank} of {len(base.parameters)} errors show, in combinations"
    ]
    for score in found.scores:
        unit, factor = ("mm", 1e3) if score.unit == "m" else ("°", degrees(1))
        before, after, median = (
            x * factor for x in (score.before, score.after, score.median)
        )
        shown.append(
            f"{score.name}, {score.rows} held-out rows: {before:.3g} {unit} before, {after:.3g} {unit} after (rms; "
            f"median {median:.3g} {unit})"
        )
    if found.outliers:
        out = (
            f"; {found.left_out} of them left out"
            if found.left_out
            else "; all of them kept"
        )
        shown.append(f"outliers: {'; '.join(found.outliers)}{out}")
    if found.hidden:
        shown.append(
            f"kept nominal, since the log does not show them: {', '.join(found.hidden)}"
        )
    if found.redundant:
        shown.append(
            f"redundant beside the other measurements: {', '.join(found.redundant)}"
        )
    return shown
