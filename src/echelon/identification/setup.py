"""Set-up files: a robot description with what its logs mean, how they are prepared and what is fitted."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from echelon.base.base_set import Identifiability
from echelon.base.model import BaseModel
from echelon.formats.load import load
from echelon.identification.physics.bounds import Bounds
from echelon.identification.settings import Settings, Setup
from echelon.identification.setup_columns import stated_columns
from echelon.inputs.content import read_content
from echelon.logs.preparation.settings import Preparation
from echelon.mechanism.effect import Effect, Side, ready_made
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism

if TYPE_CHECKING:
    from echelon.formats.schema import RobotDescription
    from echelon.formats.schema_log import IdentificationEntry

_ASSUMED = (
    "the robot file states no friction, so every joint got viscous and Coulomb friction and an offset; a set-up file "
    "with 'robot' and 'effects' can say otherwise"
)
_FRICTION = ("viscous", "coulomb", "offset")
_DESCRIPTIONS = (".yaml", ".yml", ".json")


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
    file = Path(path)
    mechanism = load(file, **reading)
    if file.suffix.lower() not in _DESCRIPTIONS:
        setup = Setup(str(file), with_friction(mechanism), robot_file=str(file), assumed=(_ASSUMED,))
    else:
        setup = _described(file, mechanism, reading)
    return setup if prior is None else replace(setup, prior=load(prior, **reading))


def _described(file: Path, mechanism: Mechanism, reading: Mapping[str, Any]) -> Setup:
    from echelon.formats.description_check import read_checked

    document, robot = read_checked(read_content(file), str(file))
    entry = robot.identification
    listed = isinstance(robot.log, tuple)
    logs = robot.log if isinstance(robot.log, tuple) else (robot.log,)
    stated = None if entry.prior.file is None else load(file.parent / entry.prior.file, **reading)
    return Setup(
        str(file),
        mechanism,
        tuple(stated_columns(log, mechanism, document, f"log[{k}]" if listed else "log") for k, log in enumerate(logs)),
        _preparation(robot),
        _settings(entry),
        stated,
        None if robot.robot is None else str(file.parent / robot.robot.file),
        excitation=robot.excitation,
    )


def with_friction(mechanism: Mechanism) -> Mechanism:
    """The mechanism with viscous and Coulomb friction and an offset in the drive of every joint coordinate."""
    effects = tuple(effect for kind in _FRICTION for effect in _at_every_joint(mechanism, kind))
    found, reading = replace(mechanism, effects=effects), mechanism.reading
    return found if reading is None else replace(found, reading=reading.followed_by(with_friction))


def _at_every_joint(mechanism: Mechanism, kind: str) -> Iterator[Effect]:
    for index, body in enumerate(mechanism.bodies):
        joint = body.joint
        motions = [m for m in joint.motions if m.name in mechanism.independent_velocities]
        body_label = mechanism.joint_label(index)
        for k, motion in enumerate(() if joint.kind == "floating" else motions):
            label = body_label if len(motions) == 1 else f"{body_label}_{k + 1}"
            slides = motion.kind is MotionKind.TRANSLATION
            yield from ready_made(kind, motion.name, Side.ACTUATOR, label, sliding=slides)


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
    """Bounds of the physical fit that a set-up states; known parameters that are seen alone are fixed.

    Parameters
    ----------
    setup : Setup
    base : BaseModel

    Raises
    ------
    InputError
        If a body or a parameter does not exist, or a range is none.
    """
    settings = setup.settings
    alone = {name for name, seen in base.classification.items() if seen is Identifiability.ALONE}
    fixed = {name: (value, value) for name, value in settings.known.items() if name in alone}
    limits = {**fixed, **settings.parameters}
    given = {"bodies": settings.bodies, "parameters": limits, "total_mass": settings.total_mass}
    return Bounds.of(base.mechanism, {key: value for key, value in given.items() if value}, setup.source)
