"""Commands about exciting trajectories.

Only click is imported here; each command imports what it needs when it runs, so that ``--help`` is instant.
"""

from __future__ import annotations

from pathlib import Path
from time import perf_counter
from typing import Annotated, Any, Literal

import click

from echelon.cli.app import AS_READ, AsJson, Force, app, reads_robot
from echelon.cli.parameters import Option, Positional
from echelon.cli.process import Exit, stop_asked
from echelon.cli.screen import steps
from echelon.shared import Family, Optimality

TRAJECTORY, PREVIEW = "trajectory.json", "preview.html"


SampleFormat = Literal["csv", "parquet", "yaml"]

SetupFile = Annotated[
    Path,
    Positional(
        help="Robot description with its sensors and the section 'excitation'; or URDF, MJCF."
    ),
]
Move = Annotated[
    list[str] | None,
    Option(metavar="NAME", help="A coordinate that moves; may be repeated."),
]
Prior = Annotated[
    Path | None,
    Option(
        help="The same robot with inertial values, for torques (URDF, MJCF, description)."
    ),
]
Model = Annotated[
    Path | None,
    Option(
        help="model.json of an identification, which predicts torques and how uncertain they are."
    ),
]


@app.command(
    epilog="Example: echelon excite examples/double_pendulum.yaml --duration 6 --starts 1 -o motion/"
)
@reads_robot(*AS_READ, "experiment")
def excite(
    setup: SetupFile,
    read: dict[str, Any],
    output: Annotated[
        Path | None,
        Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Directory for trajectory.json, samples and preview.html.",
        ),
    ] = None,
    force: Force = False,
    duration: Annotated[
        float | None, Option(help="Length of the motion, or of its period, s.")
    ] = None,
    family: Annotated[Family | None, Option(help="Functions of time.")] = None,
    harmonics: Annotated[
        int | None, Option(min=1, help="Harmonics of Fourier series.")
    ] = None,
    segments: Annotated[
        int | None, Option(min=1, help="Segments of B-splines.")
    ] = None,
    criterion: Annotated[Optimality | None, Option(help="What is optimised.")] = None,
    move: Move = None,
    starts: Annotated[
        int | None, Option(min=1, help="Random starts; the best one counts.")
    ] = None,
    seed: Annotated[
        int | None, Option(min=0, help="Seed of the random starts.")
    ] = None,
    iterations: Annotated[
        int | None,
        Option(min=1, help="Steps of the solver in each start, at most."),
    ] = None,
    budget: Annotated[
        float | None,
        Option(
            help="Budget of the search, about seconds; the best motion so far is the result."
        ),
    ] = None,
    prior_log: Annotated[
        list[Path] | None,
        Option(help="An existing log that the motion complements; may be repeated."),
    ] = None,
    prior: Prior = None,
    model: Model = None,
    formats: Annotated[
        list[SampleFormat] | None,
        Option(
            "--format", help="Format of samples; may be repeated; yaml is for ROS 2."
        ),
    ] = None,
    rate: Annotated[float, Option(help="Sampling rate, Hz.")] = 1000.0,
    repeats: Annotated[
        int, Option(min=1, help="How often a periodic motion is run.")
    ] = 1,
    as_json: AsJson = False,
) -> None:
    """Design a motion that makes every base parameter visible and keeps all limits.

    With -o: trajectory.json (coefficients and all figures), samples, and a preview page.
    """
    from echelon.cli.destination import Destination
    from echelon.cli.excite import say
    from echelon.excite import (
        design_to_json,
        exciting_trajectory,
        information_of_logs,
        text_of,
        trajectory_content,
    )
    from echelon.identification import load_setup
    from echelon.report import preview_html

    started = perf_counter()
    changed = _stated(
        duration=duration,
        family=family,
        harmonics=harmonics,
        segments=segments,
        criterion=criterion,
        move=move or None,
        starts=starts,
        seed=seed,
        iterations=iterations,
        budget=budget,
        model=model and str(model.absolute()),
    )
    kinds = [f".{one}" for one in formats or ["csv"]]
    folder = None if output is None else Destination(output, force)
    if folder is not None:
        folder.check((TRAJECTORY, PREVIEW, *(f"trajectory{kind}" for kind in kinds)))
    robot = load_setup(setup, prior=prior, **read)
    with (
        steps() as step,
        stop_asked(
            "finishing with the best motion so far; press again to stop at once"
        ) as asked,
    ):
        step("reading logs")
        information = information_of_logs(robot, prior_log) if prior_log else None
        changed |= {"on_step": step, "stopped": asked.stopped}
        found = exciting_trajectory(robot, prior_information=information, **changed)
        step("writing")
        # nothing is written unless all of it can be
        files: dict[str, str | bytes] = {}
        if folder is not None:
            files = {
                TRAJECTORY: text_of(design_to_json(found)),
                PREVIEW: preview_html(found),
            }
            for kind in kinds:
                files[f"trajectory{kind}"] = trajectory_content(
                    found.trajectory, kind, rate, repeats
                )
    say(
        found,
        [] if folder is None else folder.write_into(files),
        started,
        as_json=as_json,
    )
    if asked.number:
        raise click.exceptions.Exit(asked.code)


@app.command(
    epilog="Example: echelon check-trajectory examples/double_pendulum.yaml motion/trajectory.csv -o preview.html"
)
@reads_robot(*AS_READ, "experiment")
def check_trajectory(
    setup: SetupFile,
    trajectory: Annotated[
        Path,
        Positional(help="JSON, CSV, Parquet, or a ROS 2 JointTrajectory (YAML)."),
    ],
    read: dict[str, Any],
    output: Annotated[
        Path | None,
        Option("--output", "-o", help="Preview page to write (HTML)."),
    ] = None,
    force: Force = False,
    move: Move = None,
    prior: Prior = None,
    model: Model = None,
    as_json: AsJson = False,
) -> None:
    """Judge a trajectory made elsewhere by the limits of a set-up; exit code 1 if it breaks one."""
    from echelon.cli.destination import output_file
    from echelon.cli.excite import say
    from echelon.excite import changed as changed_entry
    from echelon.excite import judged_trajectory, read_trajectory, task_of
    from echelon.identification import load_setup
    from echelon.report import preview_html

    started, page = perf_counter(), output_file(output, force)
    changed = _stated(move=move or None, model=model and str(model.absolute()))
    robot = load_setup(setup, prior=prior, **read)
    with steps() as step:
        step("reading")
        task = task_of(robot, changed_entry(robot.excitation, changed, robot.source))
        read_from = read_trajectory(
            trajectory, task.mechanism.independent_velocities, task.limits.units
        )
        step("checking all limits")
        found = judged_trajectory(robot, read_from, **changed)
    if page is not None:
        page.write(preview_html(found))
    say(found, [] if page is None else [page.path], started, as_json=as_json)
    if not found.safe:
        raise click.exceptions.Exit(Exit.REFUTED)


def _stated(**changed: Any) -> dict[str, Any]:
    """The fields of the section ``excitation`` that are given."""
    return {name: value for name, value in changed.items() if value is not None}
