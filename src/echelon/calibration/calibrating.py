"""The job ``calibrate``: from a robot and logs of poses to a calibrated geometry, judged by held-out poses."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf
from typing import Any

import numpy as np

from echelon.algebra import DEFAULT_SEED
from echelon.base import Identifiability, LinearBase, base_parameters
from echelon.calibration.applied import Applied, applied
from echelon.calibration.errors import USUAL_SHIFT, USUAL_TURN
from echelon.calibration.fit import MOST_OUTLIERS, Fitted, GeometryFit, Observed, State
from echelon.calibration.log import observed
from echelon.calibration.model import ErrorModel
from echelon.calibration.sights import sights_of
from echelon.formats import (
    MeasureEntry,
    RobotFile,
    WrittenRobot,
    calibrated_robot,
)
from echelon.identification import Setup, check_single, listed, log_paths, setup_of
from echelon.robot import Mechanism
from echelon.shared import (
    CalibrationErrors,
    DoubtWarning,
    Flags,
    Floats,
    InputError,
    UnfitError,
    nearest_of,
    public,
    symbol_stem,
)

UNSEEN = 0.5
"""Share of the usual deviation of a combination that is left when the log says nothing of it."""
FAR = 3.0
"""Size of what is left, beside usual errors, that no calibrated geometry leaves."""
LARGE = 5.0
"""Size of a combination, beside its usual deviation, that builders do not leave: 50 mm, or 9°."""
ALIKE, WORSE = 0.8, 1.5
"""Shares of what was left before: from these on nothing was explained, or held-out rows speak against the values."""
OTHERS = 10.0
"""Size of what is left in held-out rows, beside the noise of a fit to all, from which rows explain only themselves."""
MOST_MODES = 5
"""Further modes of touching that a set takes in."""
SAME_ANGLE = 1e-5
"""Difference of angles as read and as written, rad, that no calibration tells."""
HELD = 2
"""Every second row is held out from the fit that is judged."""


@public
@dataclass(frozen=True)
class CalibrationScore:
    """Residuals of one measurement in rows that were held out.

    Attributes
    ----------
    name : str
        Of the measurement.
    unit : str
        ``"m"`` or ``"rad"``.
    rows : int
    before, after : float
        Root mean square with the nominal and with the calibrated geometry.
    median : float
        Median with the calibrated geometry.
    noise : float
        Standard deviation of the noise of one number.
    """

    name: str
    unit: str
    rows: int
    before: float
    after: float
    median: float
    noise: float


@public
@dataclass(frozen=True, repr=False)
class Calibration:
    """A calibrated geometry, made by :func:`echelon.calibrate`.

    Attributes
    ----------
    base : LinearBase
        Combinations of errors that the measurements show, with their certificate.
    values, deviations : array of shape (r,)
        Their values and standard deviations, in m, rad or their own unit.
    intervals : array of shape (r, 2)
        Of 95 %.
    hidden : tuple of str
        Combinations that the log does not show, by their representatives: they keep their nominal values.
    errors : mapping of str to float
        The smallest errors of the geometry that explain the values.
    redundant : tuple of str
        Measurements without which the others show as much of the robot.
    scores : tuple of CalibrationScore
        Residuals of held-out rows.
    outliers : tuple of str
        Rows that normal noise does not explain.
    left_out : int
        How many of them are no part of the fit.
    tools : mapping of str to array of shape (4, 4)
        Where tools sit on their bodies.
    frames : mapping of str to array of shape (4, 4)
        Where outer frames sit on theirs.
    robot : Applied
        The calibrated mechanism.
    residuals : mapping of str to (array, array)
        Size of what is left of each measurement in all rows, m or rad, before and after.
    doubts : tuple of str
        Measurements that the result does not explain.
    """

    base: LinearBase
    values: Floats
    deviations: Floats
    intervals: Floats
    hidden: tuple[str, ...]
    redundant: tuple[str, ...]
    errors: Mapping[str, float]
    scores: tuple[CalibrationScore, ...]
    outliers: tuple[str, ...]
    left_out: int
    tools: Mapping[str, Floats]
    frames: Mapping[str, Floats]
    robot: Applied
    residuals: Mapping[str, tuple[Floats, Floats]]
    file: RobotFile | None = field(default=None, repr=False)
    doubts: tuple[str, ...] = ()

    @property
    def unidentifiable(self) -> tuple[str, ...]:
        """Errors that no such measurement shows, whatever the poses."""
        kinds = self.base.classification.items()
        return tuple(
            name for name, kind in kinds if kind is Identifiability.UNIDENTIFIABLE
        )

    @cached_property
    def written(self) -> WrittenRobot:
        """The robot's file with the calibrated geometry."""
        remarks = [
            "Geometry calibrated with Echelon.",
            "Small angles are intended: read this file with --snap-tolerance 0.",
        ]
        beside = [
            name
            for name in self.errors
            if name.startswith(("ratio", "compliance", "radius"))
        ]
        remarks += [
            f"{name} = {self.errors[name]:.6g}, which no robot file states"
            for name in beside
        ]
        return calibrated_robot(
            self.robot.mechanism,
            self.robot.moves,
            self.file,
            remarks,
            self.robot.mounts,
        )

    def __repr__(self) -> str:
        parts = [
            f"{score.name}: {_shown(score.before, score.unit)} → {_shown(score.after, score.unit)}"
            for score in self.scores
        ]
        return (
            f"Calibration({self.base.rank} combinations; held out {', '.join(parts)})"
        )


def _shown(value: float, unit: str) -> str:
    return f"{value * 1e3:.3g} mm" if unit == "m" else f"{np.degrees(value):.3g}°"


Steps = Callable[[str], None]


@public
def calibrate(
    robot: Any,
    logs: Any,
    *,
    measure: Sequence[Mapping[str, Any]] | None = None,
    errors: Sequence[CalibrationErrors] = ("frames",),
    seed: int = DEFAULT_SEED,
    on_step: Steps | None = None,
) -> Calibration:
    """Calibrate the geometry of a robot by logs of poses.

    Parameters
    ----------
    robot : Mechanism, Setup, path-like, str or model
        A robot, or a description with the section ``measure``.
    logs : path-like, table or several of them
        One row for each pose: positions of the joints, and what was measured.
    measure : sequence of mapping, optional
        Entries of the section ``measure`` instead of those of the description.
    errors : sequence of str
        Errors that are looked for: ``frames``, ``modified_dh``, ``standard_dh``, ``offsets``, ``gears``, ``stiffness``.
    seed : int
    on_step : callable, optional
        Told what is being done.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        If the log lacks columns, or holds fewer numbers than what is to be found.

    Examples
    --------
    >>> import echelon as ec
    >>> found = ec.calibrate("examples/calibration/arm.yaml", "examples/calibration/tracker.csv")
    >>> found.base.rank, found.outliers
    (33, ())
    """
    say = on_step or (lambda _: None)
    setup = _as_written(setup_for(robot))
    model = error_model(setup, measure, errors)
    say("reading")
    data = observed(model, setup, log_paths(logs))
    odd = _held(data)
    fitting, held = data.part(~odd), data.part(odd)
    say("finding frames")
    nominal = GeometryFit(model, fitting, seed).start()
    say("deriving which errors the measurements show")
    base = _base(model, data, nominal, seed)
    say("fitting")
    judged = GeometryFit(model, fitting, seed).fitted(nominal, base)
    whole = GeometryFit(model, data, seed)
    found = whole.fitted(whole.framed(nominal), base)
    return _result(setup, whole, base, nominal, judged, found, held)


def _held(data: Observed) -> Flags:
    """Every second row of those that measure the same things."""
    odd = np.zeros(len(data), dtype=bool)
    for kind in np.unique(data.present, axis=0):
        same = np.flatnonzero((data.present == kind).all(axis=1))
        odd[same[HELD - 1 :: HELD]] = True
    for k in range(data.present.shape[1]):
        if not (data.present[:, k] & ~odd).any():
            odd[np.flatnonzero(data.present[:, k])] = False
    return odd


def setup_for(robot: Any) -> Setup:
    """A set-up of a mechanism, or of whatever else stands for a robot."""
    if not isinstance(robot, Mechanism):
        return check_single(setup_of(robot))
    file = None if robot.reading is None else robot.reading.file
    stated = file.robot if isinstance(file, RobotFile) else None
    return Setup(robot.name, robot, robot_file=stated)


def _as_written(setup: Setup) -> Setup:
    """A set-up whose robot has the numbers of its file, where these are what changes in a calibrated file.

    An angle of 1.57 that is read as π/2 stays 1.57 in the calibrated file, and its rest would be missing there.
    """
    file, reading = setup.robot_file, setup.mechanism.reading
    edited = file is not None and not file.is_description and file.root.tag != "sdf"
    if not edited or reading is None or not isinstance(reading.file, RobotFile):
        return setup
    if all(snap.difference <= SAME_ANGLE for snap in reading.snaps):
        return setup
    options = replace(reading.options, snap_tolerance=0.0)
    literal = reading.file.mechanism(options)
    if literal.positions != setup.mechanism.positions:
        raise InputError(
            "its file has rounded angles: read it with  snap_tolerance=0, since the calibrated file keeps them"
        )
    return replace(setup, mechanism=literal)


def error_model(
    setup: Setup,
    measure: Sequence[Mapping[str, Any]] | None,
    errors: Sequence[CalibrationErrors],
) -> ErrorModel:
    """Error model of a set-up's robot: measurements, and the errors that are looked for."""
    entries: Sequence[MeasureEntry] = ()
    if measure is not None:
        entries = [_entry(entry, k) for k, entry in enumerate(measure)]
    else:
        entries = setup.measure
    sights = sights_of(setup.mechanism, entries)
    if not errors:
        raise InputError("no errors to find: name some, such as  frames")
    return ErrorModel(setup.mechanism, sights, frozenset(errors))


def _entry(stated: Mapping[str, Any], count: int) -> MeasureEntry:
    """A measurement that is stated in Python, or what is wrong with it."""
    try:
        return MeasureEntry.model_validate(dict(stated))
    except UnfitError as error:
        problem, key = error.problem, error.unknown
        place = [str(part) for part in error.where[:1]]
        if key is not None:
            problem = (
                f"unknown key '{key}'{nearest_of(key, list(MeasureEntry.model_fields))}"
            )
        where = ".".join([f"measure[{count}]", *place])
        raise InputError(problem, element=where) from None


@public
def calibration_base(
    robot: Any,
    *,
    measure: Sequence[Mapping[str, Any]] | None = None,
    errors: Sequence[CalibrationErrors] = ("frames",),
    seed: int = DEFAULT_SEED,
) -> LinearBase:
    """Combinations of geometric errors that measurements can show, in closed form and certified.

    Parameters
    ----------
    robot, measure, errors, seed
        As for :func:`calibrate`.  Tools are where their bodies are, at the stated points; markers at unknown places and
        fixed points of distances are where ``seed`` puts them, in general position.

    Returns
    -------
    LinearBase

    Examples
    --------
    >>> import echelon as ec
    >>> base = ec.calibration_base("examples/panda.yaml")
    >>> base.rank, len(base.parameters)
    (34, 54)
    """
    return error_model(setup_for(robot), measure, errors).base(seed=seed)


def redundant_sights(
    model: ErrorModel, frames: Mapping[str, Floats]
) -> tuple[str, ...]:
    """Measurements that show no more of the robot than the others, beside their own frames.

    Surfaces and loops take seconds each and are not compared.
    """
    found: list[str] = []
    entries = {sight.name.partition(".")[0]: sight.entry for sight in model.sights}
    if len(entries) < 2 or any(sight.constrains for sight in model.sights):
        return ()
    whole = _shown_of_robot(model, frames)
    for name, entry in entries.items():
        others = tuple(sight for sight in model.sights if sight.entry is not entry)
        less = ErrorModel(model.mechanism, others, model.kinds)
        if _shown_of_robot(less, frames) == whole:
            found.append(name)
    return tuple(found)


def _shown_of_robot(model: ErrorModel, frames: Mapping[str, Floats]) -> int:
    """Number of combinations that show beside those of frames that nobody knows."""
    unknown = [error.name for error in model.errors if error.usual == inf]
    base = base_parameters(model.linear(frames, None), prefer=unknown)
    return base.rank - len(set(base.pivots) & set(unknown))


def _base(model: ErrorModel, data: Observed, nominal: State, seed: int) -> LinearBase:
    """Combinations that show near the poses of a log, in all modes in which surfaces are touched."""
    touching = [sight.constrains and sight.closure is None for sight in model.sights]
    q = data.q[data.present[:, touching].any(axis=1)]
    if not len(q):
        return model.base(nominal.frames, seed=seed)
    poses = q[:1]
    base = model.base(nominal.frames, poses, seed)
    for _ in range(MOST_MODES):
        others = model.poses_of_other_modes(base, q, nominal.frames)
        if not len(others):
            break
        poses = np.vstack([poses, others])
        base = model.base(nominal.frames, poses, seed)
    return base


def _result(
    setup: Setup,
    fit: GeometryFit,
    base: LinearBase,
    nominal: State,
    judged: Fitted,
    found: Fitted,
    held: Observed,
) -> Calibration:
    """Everything that a user reads."""
    model, data = fit.model, fit.data
    before = fit.sizes(fit.residuals(nominal, held))
    after = fit.sizes(fit.residuals(judged.state, held))
    scores = []
    for (channel, first), (_, last), noise in zip(
        before, after, found.state.noise, strict=True
    ):
        rows = held.present[:, channel.sight]
        if rows.any():
            start, end = (
                float(np.sqrt(np.mean(size[rows] ** 2))) for size in (first, last)
            )
            median = float(np.median(last[rows]))
            scores.append(
                CalibrationScore(
                    channel.name,
                    channel.unit,
                    int(rows.sum()),
                    start,
                    end,
                    median,
                    float(noise),
                )
            )
    usual = np.sqrt(np.diag(found.spread))
    hidden = [
        p
        for p, d, u in zip(base.pivots, found.deviations, usual, strict=True)
        if d > UNSEEN * u
    ]
    errors = dict(
        zip((e.name for e in model.errors), found.state.errors.tolist(), strict=True)
    )
    robot = applied(model.mechanism, errors)
    state = fit.absorbed(found.state)
    ends = {
        name
        for sight in model.sights
        if sight.closure is None
        for name in (sight.tool, sight.frame)
    }
    tools = {
        s.tool: robot.place(s.body, state.frames[s.tool])
        for s in model.sights
        if s.tool in ends
    }
    frames = {
        s.frame: robot.place(s.on, state.frames[s.frame])
        for s in model.sights
        if s.frame in ends
    }
    kept = {
        name: value
        for name, value in errors.items()
        if not any(name[2:] == symbol_stem(end) for end in ends)
    }
    sizes = zip(
        fit.sizes(fit.residuals(nominal)),
        fit.sizes(fit.residuals(found.state)),
        strict=True,
    )
    residuals = {
        f"{channel.name} ({channel.unit})": (
            first[data.present[:, channel.sight]],
            last[data.present[:, channel.sight]],
        )
        for (channel, first), (_, last) in sizes
    }
    doubts = (
        *_doubts(scores),
        *(
            f"measure '{model.sights[k].name}': more than {MOST_OUTLIERS:.0%} of its rows are far from a robust "
            "fit of the others, too many for outliers, and all are kept: check for a log of two set-ups"
            for k in found.crowded
        ),
        *_large(base, found.z, usual),
    )
    for doubt in doubts:
        warnings.warn(doubt, DoubtWarning, stacklevel=3)
    return Calibration(
        base,
        found.z,
        found.deviations,
        fit.intervals(found),
        tuple(hidden),
        redundant_sights(model, nominal.frames),
        kept,
        tuple(scores),
        _outliers(model, data, found.outlying),
        int(found.left_out.sum()),
        tools,
        frames,
        robot,
        residuals,
        setup.robot_file,
        doubts,
    )


def _doubts(scores: Sequence[CalibrationScore]) -> tuple[str, ...]:
    """Measurements that the calibrated geometry does not explain, with what often is the cause."""
    found = []
    for score in scores:
        usual = USUAL_SHIFT if score.unit == "m" else USUAL_TURN
        after = score.median  # which outliers hardly move
        seen_only = after > OTHERS * score.noise  # rows of the fit are explained
        large = after > FAR * usual
        unexplained = after > ALIKE * score.before and after > usual / 2
        worse = after > WORSE * score.before and after > usual / 100
        end = f"{_shown(score.before, score.unit)} before and {_shown(score.after, score.unit)} after"
        if (large or unexplained) and not seen_only:
            found.append(
                f"measure '{score.name}': no small errors explain it, with {end} in held-out rows: check for "
                "degrees read as rad, mm as m, Euler angles as a rotation vector, the inverse pose, and the order "
                "of columns or joints"
            )
        elif worse or large or unexplained:
            found.append(
                f"measure '{score.name}': the fit explains the poses of the fit, but not the held-out ones, with {end}: "
                "measure more poses"
            )
    return tuple(found)


def _large(base: LinearBase, z: Floats, usual: Floats) -> tuple[str, ...]:
    """Values that no builder of robots leaves."""
    far = np.flatnonzero(np.abs(z) > LARGE * usual)
    shown = [f"{base.pivots[k]} ({z[k]:.2g} {base.units[k]})" for k in far]
    if not shown:
        return ()
    return (
        f"more than {LARGE:g} times what is usual: {listed(shown)}: a zero position may be that far off; if none is, look "
        "for a joint that turns the other way, another order of joints, and other units or zeros of the log",
    )


def _outliers(model: ErrorModel, data: Observed, outlying: Flags) -> tuple[str, ...]:
    """Rows that normal noise does not explain, by measurement."""
    found = []
    for k, sight in enumerate(model.sights):
        rows = data.rows[outlying[:, k]].astype(int).tolist()
        if rows:
            found.append(f"{sight.name}: row {', '.join(map(str, rows))}")
    return tuple(found)
