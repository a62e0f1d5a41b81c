"""Commands about exciting trajectories.

Only typer is imported here; each command imports what it needs when it runs, so that ``--help`` is instant.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from echelon.cli.app import app
from echelon.cli.options import AsJson, EveryLink, Floating, Force, Gravity, Massless, Tolerance, reading


class CriterionName(StrEnum):
    """What is optimised."""

    D_OPTIMAL = "d_optimal"
    A_OPTIMAL = "a_optimal"
    CONDITION = "condition"


class FamilyName(StrEnum):
    """Functions of time."""

    FOURIER = "fourier"
    BSPLINE = "bspline"
    SUM = "sum"


SetupFile = Annotated[
    Path, typer.Argument(help="Robot description with its sensors and the section 'excitation'; or URDF, MJCF.")
]
Prior = Annotated[
    Path | None, typer.Option(help="The same robot with inertial values, for torques (URDF, MJCF, description).")
]
Model = Annotated[
    Path | None,
    typer.Option(help="model.json of an identification, which predicts torques and how uncertain they are."),
]


@app.command(epilog="Example: echelon excite ur10.yaml -o motion/ --duration 10 --criterion condition")
def excite(
    setup: SetupFile,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Directory for trajectory.json, samples and preview.html.")
    ] = None,
    force: Force = False,
    duration: Annotated[float | None, typer.Option(help="Length of the motion, or of its period, s.")] = None,
    family: Annotated[FamilyName | None, typer.Option(help="Functions of time.")] = None,
    harmonics: Annotated[int | None, typer.Option(min=1, help="Of Fourier series.")] = None,
    pieces: Annotated[int | None, typer.Option(min=1, help="Of B-splines.")] = None,
    criterion: Annotated[CriterionName | None, typer.Option(help="What is optimised.")] = None,
    move: Annotated[list[str] | None, typer.Option(help="A coordinate that moves; may be repeated.")] = None,
    starts: Annotated[int | None, typer.Option(min=1, help="Random starts; the best one counts.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Of the random starts.")] = None,
    iterations: Annotated[int | None, typer.Option(min=1, help="Steps of the solver in each start, at most.")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Starts that run at the same time.")] = None,
    complement: Annotated[
        list[Path] | None, typer.Option(help="A log at hand, which the trajectory complements; may be repeated.")
    ] = None,
    prior: Prior = None,
    model: Model = None,
    formats: Annotated[
        list[str] | None, typer.Option("--format", "-f", help="Of samples: csv, parquet or yaml (ROS 2).")
    ] = None,
    rate: Annotated[float, typer.Option(help="Of samples, Hz.")] = 1000.0,
    repeats: Annotated[int, typer.Option(min=1, help="How often a periodic motion is run.")] = 1,
    floating: Floating = False,
    gravity: Gravity = "file",
    tolerance: Tolerance = None,
    every_link: EveryLink = False,
    massless: Massless = None,
    as_json: AsJson = False,
) -> None:
    """Design a motion that makes every base parameter visible and keeps all limits at every time.

    With -o: trajectory.json (coefficients and all figures), samples, and a preview page.
    """
    from echelon.cli.destination import output_folder
    from echelon.cli.excite import ExciteRequest, run_excite

    changed = {
        "duration": duration,
        "family": family and family.value,
        "harmonics": harmonics,
        "pieces": pieces,
        "criterion": criterion and criterion.value,
        "move": move or None,
        "starts": starts,
        "seed": seed,
        "iterations": iterations,
        "model": model and str(model.absolute()),
    }
    request = ExciteRequest(
        setup,
        None if output is None else output_folder(output, force),
        prior,
        tuple(complement or ()),
        _stated(changed),
        reading(floating, gravity, tolerance, every_link=every_link, massless=massless),
        tuple(formats or ("csv",)),
        rate,
        repeats,
        jobs,
    )
    run_excite(request, as_json=as_json)


@app.command(epilog="Example: echelon check-trajectory ur10.yaml motion.csv -o preview.html")
def check_trajectory(
    setup: SetupFile,
    trajectory: Annotated[Path, typer.Argument(help="JSON, CSV, Parquet, or a ROS 2 JointTrajectory (YAML).")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Preview page to write (HTML).")] = None,
    force: Force = False,
    move: Annotated[list[str] | None, typer.Option(help="A coordinate that moves; may be repeated.")] = None,
    prior: Prior = None,
    model: Model = None,
    floating: Floating = False,
    gravity: Gravity = "file",
    tolerance: Tolerance = None,
    every_link: EveryLink = False,
    massless: Massless = None,
    as_json: AsJson = False,
) -> None:
    """Judge a trajectory made elsewhere by the limits of a set-up; exit code 1 if it breaks one."""
    from echelon.cli.destination import output_file
    from echelon.cli.excite import run_check

    read = reading(floating, gravity, tolerance, every_link=every_link, massless=massless)
    changed = {"move": move or None, "model": model and str(model.absolute())}
    run_check(setup, trajectory, output_file(output, force), prior, _stated(changed), read, as_json=as_json)


def _stated(changed: Mapping[str, Any]) -> dict[str, Any]:
    """What was asked for, of what can be."""
    return {name: value for name, value in changed.items() if value is not None}
