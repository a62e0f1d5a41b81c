"""Commands about measured logs.

Only typer is imported here; each command imports what it needs when it runs, so that ``--help`` is instant.
"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from echelon.cli.app import app
from echelon.cli.options import AsJson, EveryLink, Floating, Force, Gravity, Massless, Seed, Tolerance, reading


class EstimatorName(StrEnum):
    """Estimators of the base parameters."""

    OLS = "ols"
    WLS = "wls"
    IRLS = "irls"
    HUBER = "huber"
    TLS = "tls"
    RIDGE = "ridge"
    IV = "iv"


class Values(StrEnum):
    """Which values predictions use."""

    ESTIMATE = "estimate"
    ESSENTIAL = "essential"
    PHYSICAL = "physical"


Logs = Annotated[
    list[Path], typer.Argument(help="CSV, Parquet, NPZ, MAT, ROS 2 bag or MCAP; a directory stands for all logs in it.")
]


@app.command(epilog="Example: echelon identify tx40.yaml run1.parquet --validate run2.parquet -o result/")
def identify(
    setup: Annotated[Path, typer.Argument(help="Robot description with its measurement set-up; or URDF, MJCF.")],
    logs: Logs,
    validate: Annotated[
        list[Path] | None, typer.Option("--validate", "-v", help="A log the fit does not see; may be repeated.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Directory for model, report, robot file and code.")
    ] = None,
    force: Force = False,
    prior: Annotated[
        Path | None, typer.Option(help="The same robot with inertial values that are believed beforehand (URDF, …).")
    ] = None,
    estimator: Annotated[EstimatorName | None, typer.Option(help="Instead of the one of the set-up.")] = None,
    use: Annotated[Values | None, typer.Option(help="Values that predictions use, instead of the set-up's.")] = None,
    holdout: Annotated[
        float | None, typer.Option(min=0, max=0.9, help="Share of each log held out where no other log validates.")
    ] = None,
    physical: Annotated[
        bool | None, typer.Option("--physical/--no-physical", help="Fit a physically consistent robot as well.")
    ] = None,
    target: Annotated[str, typer.Option("--target", "-t", help="Language of the model's source, or none.")] = "c",
    dask: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, or a number of processes to start here.")
    ] = None,
    floating: Floating = False,
    gravity: Gravity = "file",
    tolerance: Tolerance = None,
    every_link: EveryLink = False,
    massless: Massless = None,
    seed: Seed = None,
    as_json: AsJson = False,
) -> None:
    """Fit a robot's parameters to logs, validate the model on data it did not see, and write it.

    With -o: model.json, report.html, the robot with identified inertials, and source code of the fitted model.
    """
    from echelon.cli.destination import output_folder
    from echelon.cli.identify import IdentifyRequest, run_identify

    changed = {
        "estimator": estimator and estimator.value,
        "predict": use and use.value,
        "holdout": holdout,
        "physical": physical,
        "seed": seed,
    }
    request = IdentifyRequest(
        setup,
        tuple(logs),
        tuple(validate or ()),
        None if output is None else output_folder(output, force),
        prior,
        {name: value for name, value in changed.items() if value is not None},
        reading(floating, gravity, tolerance, every_link=every_link, massless=massless),
        target,
        dask,
    )
    run_identify(request, as_json=as_json)


@app.command(epilog="Example: echelon predict result/model.json run3.parquet -o predicted.csv")
def predict(
    model: Annotated[Path, typer.Argument(help="model.json that 'echelon identify' wrote.")],
    log: Annotated[Path, typer.Argument(help="A log of positions; outputs are compared where it has them.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="CSV or Parquet file with time, predicted and measured.")
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Predict the outputs of a log with an identified model."""
    from echelon.cli.destination import output_file
    from echelon.cli.predict import run_predict

    run_predict(model, log, output_file(output, force), as_json=as_json)
