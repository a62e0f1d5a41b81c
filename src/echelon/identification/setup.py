"""Set-up files: a robot description with what its logs mean, how they are prepared and what is fitted."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from echelon.base.base_set import Identifiability
from echelon.base.model import BaseModel
from echelon.formats.reading_options import ReadingOptions
from echelon.formats.robot_file import RobotFile, open_robot
from echelon.identification.physics.bounds import Bounds
from echelon.identification.settings import Settings, Setup
from echelon.identification.setup_columns import stated_columns
from echelon.logs.preparation.settings import Preparation

if TYPE_CHECKING:
    from echelon.formats.schema.robot_schema import RobotDescription
    from echelon.formats.schema.schema_log import IdentificationEntry

_ASSUMED = (
    "the robot file states no friction, so every joint got viscous and Coulomb friction and an offset; a set-up file "
    "with 'robot' and 'effects' can say otherwise"
)


def load_setup(path: str | os.PathLike[str], *, prior: str | os.PathLike[str] | None = None, **reading: Any) -> Setup:
    """Read a robot with its measurement set-up.

    Parameters
    ----------
    path : path-like
        An Echelon description, whose sections ``log``, ``preparation`` and ``identification`` are read as well; or a
        bare URDF or MJCF file, for which everything is left to choose, and whose joints get friction and an offset.
    prior : path-like, optional
        Another description of the robot with inertial values, instead of the one that the file names.
    **reading
        Keyword arguments of :func:`echelon.load`.

    Returns
    -------
    Setup

    Raises
    ------
    InputError
        If a file cannot be read, or a section refers to something that does not exist; names file and element.

    Examples
    --------
    >>> import echelon as ec
    >>> setup = ec.load_setup("examples/logs/emps.yaml")
    >>> setup.columns[0].positions["slide"].column, setup.preparation.cutoff
    ('q_meas_m', 100.0)
    """
    file, options = open_robot(path), ReadingOptions(**reading)
    if file.is_description:
        setup = _described(file, options)
    else:
        mechanism = file.mechanism(replace(options, friction=True))
        setup = Setup(file.source, mechanism, robot_file=file, assumed=(_ASSUMED,))
    return setup if prior is None else replace(setup, prior=open_robot(prior).mechanism(options))


def _described(file: RobotFile, options: ReadingOptions) -> Setup:
    mechanism, robot, document = file.mechanism(options), file.description, file.checked_document
    entry = robot.identification
    listed = isinstance(robot.log, tuple)
    logs = robot.log if isinstance(robot.log, tuple) else (robot.log,)
    folder, prior = file.directory or Path(), entry.prior.file
    stated = None if prior is None else open_robot(folder / prior).mechanism(options)
    return Setup(
        file.source,
        mechanism,
        tuple(stated_columns(log, mechanism, document, f"log[{k}]" if listed else "log") for k, log in enumerate(logs)),
        _preparation(robot),
        _settings(entry),
        stated,
        file.robot,
        excitation=robot.excitation,
    )


def _preparation(robot: RobotDescription) -> Preparation:
    stated = robot.preparation
    return Preparation(**{name: getattr(stated, name) for name in type(stated).model_fields})


def _settings(entry: IdentificationEntry) -> Settings:
    return Settings(
        estimator=entry.estimator,
        known=dict(entry.known),
        holdout=entry.holdout,
        physical=entry.physical,
        predict=entry.predict,
        essential=entry.essential,
        prior_weight=entry.prior.weight,
        bodies={name: bounds.model_dump(exclude_unset=True) for name, bounds in entry.bodies.items()},
        parameters=dict(entry.parameters),
        total_mass=entry.total_mass,
        intervals=entry.intervals,
        level=entry.level,
    )


def stated_bounds(setup: Setup, base: BaseModel) -> Bounds:
    """Bounds of the physical fit that a set-up states; known parameters that are seen alone are fixed."""
    settings = setup.settings
    alone = {name for name, seen in base.classification.items() if seen is Identifiability.ALONE}
    fixed = {name: (value, value) for name, value in settings.known.items() if name in alone}
    limits = {**fixed, **settings.parameters}
    given = {"bodies": settings.bodies, "parameters": limits, "total_mass": settings.total_mass}
    return Bounds.of(base.mechanism, {key: value for key, value in given.items() if value}, setup.source)
