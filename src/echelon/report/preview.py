"""The preview: one page that shows a trajectory, and how far it stays from every limit, before a robot runs it.

What would stop an engineer comes first: broken limits, then warnings.  The motion follows, then the numbers.  Signals
are sampled densely against the fastest component of their family, and thinned only where a page would be too large.

In the moving picture a body goes from its frame to those of the bodies that it carries.  A last body, whose length
nobody states, goes on as its parent came when all joints are at zero, or as it slides, and turns with its frame.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite, isnan
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.dynamics import Kinematics
from echelon.excite import (
    ACTIVE,
    FARTHEST,
    ORDERS,
    SAMPLES_PER_PERIOD,
    ExcitingTrajectory,
    Margin,
    PairDistance,
    Shape,
    ShapeKind,
    positions_along,
    when_kept,
)
from echelon.report.drawing import (
    PROPORTIONS,
    ahead,
    joint_axes,
    widest_view,
)
from echelon.report.outlines import outline
from echelon.report.page import (
    PACKED_NUMBER_BYTES,
    PLOT_BYTES,
    VAGUE_PERCENT,
    ClosedForms,
    Context,
    html_page,
    packed,
    significant,
    stretches_for,
)
from echelon.report.report import findings_of
from echelon.report.signals import envelope
from echelon.robot import Body, Mechanism, MotionKind, known_values, upward
from echelon.shared import (
    EchelonError,
    Floats,
    InputError,
    one_line,
    plain_data,
    public,
)

TITLES = {
    "robot": "How the robot moves",
    "motion": "Joint motion against its limits",
    "limits": "Margins to every limit",
    "showing": "Expected accuracy",
    "starts": "Starts of the optimisation",
    "settings": "Settings",
}
"""Sections below the header, in order."""

CRITERIA = {
    "d_optimal": "smallest confidence ellipsoid (D-optimal)",
    "a_optimal": "smallest sum of variances (A-optimal)",
    "condition": "smallest condition number",
}
"""The criteria in words."""

ROOM_BESIDE_LIMITS = 0.1
"""Share of the width of a picture that is left beside limits, on both sides."""
MOST_SAMPLES = 20_000
"""Samples of a coordinate that are evaluated for a plot: of a motion of some minutes all, of hours enough."""
_SUFFIXES = ("", "/s", "/s²")  # units of positions, velocities, accelerations
_PLOTTED = range(len(_SUFFIXES))


@public
def preview_html(found: ExcitingTrajectory) -> str:
    """A page about an exciting trajectory, as one HTML file.

    Equal trajectories give equal texts.  Names that come from files are escaped; nothing is loaded from anywhere.

    Parameters
    ----------
    found : ExcitingTrajectory

    Returns
    -------
    str
        To be written as UTF-8.

    Raises
    ------
    MissingExtraError
        If plotly is not installed.
    """
    picture, pictures = robot(found)
    contexts = {
        "header": _header(found),
        "robot": picture,
        "motion": _motion(found),
        "limits": _limits(found),
        "showing": _showing(found),
        "starts": _starts(found),
        "settings": {
            "repeat": json.dumps(
                plain_data(found.settings, "none"),
                indent=2,
                ensure_ascii=False,
                default=str,
            )
        },
    }
    seen = [
        (time, condition)
        for time, condition in found.conditioning.over_time
        if isfinite(condition)
    ]
    data = {
        "robot": pictures,
        "motion": _signals(found),
        "distances": _distances(found),
        "conditioning": {
            "time": [time for time, _ in seen],
            "condition": [condition for _, condition in seen],
        },
        "starts": [
            {"number": s.number, "history": [v for v in s.history if isfinite(v)]}
            for s in found.starts
        ],
    }
    return html_page(
        f"Exciting trajectory of {one_line(found.base.mechanism.name)}",
        "preview_",
        TITLES,
        contexts,
        data,
        styles=["preview.css"],
        scripts=["preview.js", "preview_robot.js", "preview_plots.js"],
        without_script="The moving picture and the plots need JavaScript, which is switched off.",
    )


def _header(found: ExcitingTrajectory) -> Context:
    """May this run?  The verdict on the limits, what else is wrong, and how well the parameters will be seen."""
    conditioning = found.conditioning
    return {
        "robot": found.base.mechanism.name,
        "verdict": verdict(found.margins, found.unchecked),
        "safe": found.safe and bool(found.margins),
        "doubtful": bool(found.unchecked),
        "broken": [margin for margin in found.margins if not margin.kept],
        "active": found.active,
        "limits": len(found.margins),
        "blind": not isfinite(conditioning.condition),
        **findings_of(found.findings),
        "criterion": CRITERIA.get(found.criterion, found.criterion),
        "held": [
            (name, significant(position)) for name, position in found.held.items()
        ],
        "moving": found.trajectory.coordinates,
        "facts": [
            ("duration", significant(found.trajectory.duration), "s"),
            ("condition number", significant(conditioning.condition), ""),
            (
                "condition number, columns of norm 1",
                significant(conditioning.scaled_condition),
                "",
            ),
            ("log det of the information", significant(conditioning.log_det), ""),
            ("base parameters", str(found.base.rank), ""),
        ],
    }


def verdict(margins: tuple[Margin, ...], unchecked: tuple[str, ...] = ()) -> str:
    """Whether limits are kept, in words, and what no limit says anything about.

    >>> verdict((Margin("velocity of j1", "rad/s", -2.0, 2.0, -1.0, 1.5),))
    'Every limit is kept at every time.'
    >>> verdict((Margin("velocity of j1", "rad/s", -2.0, 2.0, -1.0, 2.5),))
    'Do not run this: 1 of 1 limits is broken.'
    """
    broken = sum(1 for margin in margins if not margin.kept)
    if not margins:
        return "No limit is checked."
    if not broken:
        checked = "Every checked limit" if unchecked else "Every limit"
        return "; ".join((f"{checked} is kept {when_kept(margins)}", *unchecked)) + "."
    return f"Do not run this: {broken} of {len(margins)} limits {'is' if broken == 1 else 'are'} broken."


def _said(found: ExcitingTrajectory, kind: str) -> str:
    """The finding of a kind as a sentence, if there is one."""
    texts = [finding.text for finding in found.findings if finding.kind == kind]
    return f"{texts[0][0].upper()}{texts[0][1:]}." if texts else ""


def _motion(found: ExcitingTrajectory) -> Context:
    """Coordinates, and those of their quantities that have no limit."""
    labels = {margin.label for margin in found.margins}
    quantities = [
        _quantity(name, order)
        for name in found.trajectory.coordinates
        for order in _PLOTTED
    ]
    return {
        "coordinates": found.trajectory.coordinates,
        "free": [label for label in quantities if label not in labels],
    }


def _quantity(coordinate: str, order: int) -> str:
    """A derivative of a coordinate as margins call it."""
    return f"{ORDERS[order]} of {coordinate}"


def _signals(found: ExcitingTrajectory) -> dict[str, Any]:
    """Positions, velocities and accelerations of every coordinate with their limits, JSON-able."""
    trajectory = found.trajectory
    plots = len(_PLOTTED) * len(trajectory.coordinates)
    buckets = stretches_for([MOST_SAMPLES] * plots, PLOT_BYTES // 2)
    periods = trajectory.basis.frequency * trajectory.duration
    wanted = np.ceil(SAMPLES_PER_PERIOD * periods)
    samples = int(np.clip(wanted, buckets, MOST_SAMPLES)) + 1
    time = np.linspace(0.0, trajectory.duration, samples)
    values = [trajectory(time, order) for order in _PLOTTED]
    ends = {margin.label: (margin.low, margin.high) for margin in found.margins}

    def signal(k: int, order: int) -> dict[str, Any]:
        kept = envelope(time, values[order][:, k], buckets)
        low, high = ends.get(_quantity(trajectory.coordinates[k], order), (-inf, inf))
        return {
            "unit": one_line(trajectory.units[k]) + _SUFFIXES[order],
            "time": packed(kept.time),
            "values": packed(kept.values),
            "low": low if isfinite(low) else None,
            "high": high if isfinite(high) else None,
        }

    coordinates = []
    for k, name in enumerate(trajectory.coordinates):
        orders = [signal(k, order) for order in _PLOTTED]
        coordinates.append({"name": one_line(name), "orders": orders})
    return {
        "duration": trajectory.duration,
        "titles": list(ORDERS[: len(_SUFFIXES)]),
        "coordinates": coordinates,
    }


MOST_PAIRS = 8
"""Pairs in a plot of distances: as many as there are colours."""


@dataclass(frozen=True)
class _PairGroup:
    """Pairs whose distances stand in one plot, those that come nearest to their clearance first."""

    title: str
    pairs: tuple[PairDistance, ...]
    more: int  # pairs that stay further away and are not drawn


def _pair_groups(found: ExcitingTrajectory) -> list[_PairGroup]:
    """Distances to obstacles, and those within the robot, as far as the motion changes them."""
    groups = []
    for obstacle, title in ((True, "to obstacles"), (False, "within the robot")):
        pairs = [
            pair
            for pair in (found.closeness.pairs if found.closeness else ())
            if pair.obstacle is obstacle and not pair.steady
        ]
        if pairs:
            shown = tuple(pairs[:MOST_PAIRS])
            groups.append(_PairGroup(title, shown, len(pairs) - len(shown)))
    return groups


def _distances(found: ExcitingTrajectory) -> dict[str, Any] | None:
    """Distances over time, JSON-able; None where none is checked."""
    if found.closeness is None:
        return None
    return {
        "time": packed(found.closeness.time),
        "groups": [
            [
                {
                    "name": _pair_name(pair),
                    "low": pair.low,
                    # further away there is a gap
                    "distance": packed(
                        np.where(pair.distance < FARTHEST, pair.distance, np.nan)
                    ),
                }
                for pair in group.pairs
            ]
            for group in _pair_groups(found)
        ],
    }


def _pair_name(pair: PairDistance) -> str:
    return one_line(pair.label.removeprefix("distance of "))


def _limits(found: ExcitingTrajectory) -> Context:
    """Table of limits: the allowed value, the reached one and the margin, least margin first."""
    pairs = found.closeness.pairs if found.closeness else ()
    measured = {pair.label: pair.least for pair in pairs if pair.least < FARTHEST}
    rows = sorted(
        (_limit(margin, measured.get(margin.label)) for margin in found.margins),
        key=_urgency,
    )
    counts = {
        state: sum(row["state"] == state for row in rows)
        for state in ("broken", "active", "kept")
    }
    return {
        "groups": _pair_groups(found),
        "steady": [
            (_pair_name(pair), pair.least)
            for pair in pairs
            if pair.steady and pair.least < FARTHEST
        ],
        "farthest": FARTHEST,
        "used": _said(found, "limits"),
        "rows": rows,
        "counts": counts,
        "near": f"{100 * ACTIVE:g}",
        "when": when_kept(found.margins),
    }


def _limit(margin: Margin, measured: float | None) -> Context:
    """One limit, with what is reached in per cent of the width of a picture in which the limits stand at 10 and 90.

    Of a distance also the smallest one at samples is told, since what is proved may be less.
    """
    state = "active" if margin.active else "kept" if margin.kept else "broken"
    left, right = (_place(margin, value) for value in (margin.least, margin.largest))
    return {
        "margin": margin,
        "state": state,
        "percent": 100 * margin.relative,
        "left": left,
        "width": right - left,
        "measured": measured,
        "allowed": _interval(margin.low, margin.high, "≥", "≤"),
        "reached": _interval(margin.least, margin.largest, "at least", "at most"),
        "picture": isfinite(margin.high - margin.low),
    }


def _interval(low: float, high: float, above: str, below: str) -> str:
    """Two ends in words; one that is infinite is not there."""
    if high == inf and isfinite(low):
        return f"{above} {significant(low)}"
    if low == -inf and isfinite(high):
        return f"{below} {significant(high)}"
    return f"{significant(low)} … {significant(high)}"


def _urgency(row: Context) -> tuple[int, float]:
    """Broken ones before active ones before others, each by their share of the range; unknown shares first."""
    order = ("broken", "active", "kept").index(row["state"])
    return order, -inf if isnan(row["percent"]) else row["percent"]


def _place(margin: Margin, value: float) -> float:
    """Where a value stands between the limits, 0 to 100; zero or the value itself replaces a limit that is missing."""
    low = margin.low if isfinite(margin.low) else min(margin.least, 0.0)
    high = margin.high if isfinite(margin.high) else max(margin.largest, 0.0)
    span = high - low
    if not (isfinite(value) and isfinite(span) and span > 0):
        return 50.0
    room = ROOM_BESIDE_LIMITS
    return 100 * min(max(room + (1 - 2 * room) * (value - low) / span, 0.0), 1.0)


def _showing(found: ExcitingTrajectory) -> Context:
    """How conditioning grows with time, and how exactly each base parameter will be known."""
    base, conditioning = found.base, found.conditioning
    try:
        values: list[float | None] = base.values().tolist()
    except InputError:  # the file states no inertia, or a length has no value
        values = [None] * base.rank
    each = zip(
        ClosedForms(base).all(), base.units, conditioning.std, values, strict=True
    )
    rows = [
        {"form": form, "unit": unit, **_expected(std, value)}
        for form, unit, std, value in each
    ]
    return {
        "shown": conditioning,
        "rows": rows,
        "known": any(value is not None for value in values),
        "vague": sum(row["vague"] for row in rows),
        "singular": max(
            (
                time
                for time, condition in conditioning.over_time
                if not isfinite(condition)
            ),
            default=0.0,
        ),
        "noise": _noise(found),
    }


def _expected(std: float, value: float | None) -> Context:
    """A deviation, SI units, beside the value of the robot file, also in per cent of it."""
    percent = None if value is None else 100 * std / abs(value) if value else inf
    return {
        "std": std,
        "value": value,
        "percent": percent,
        "vague": percent is not None and not percent <= VAGUE_PERCENT,
    }


def _noise(found: ExcitingTrajectory) -> str:
    """Noise that the deviations are for, as the settings state it."""
    section = found.settings.get("excitation")
    noise = section.get("noise") if isinstance(section, Mapping) else None
    if not isinstance(noise, Mapping):
        return ""
    parts = [
        f"{significant(float(value), 3)} ({name})" for name, value in noise.items()
    ]
    return ", ".join(
        part.removesuffix(" (all)") if len(parts) == 1 else part for part in parts
    )


def _starts(found: ExcitingTrajectory) -> Context:
    """Starts of the optimisation, which tell whether another one would find more."""
    values = [start.value for start in found.starts if isfinite(start.value)]
    return {
        "starts": found.starts,
        "best": min(values, default=None),
        "failed": len(found.starts) - len(values),
        "curves": any(len(start.history) > 1 for start in found.starts),
        "criterion": found.criterion,
    }


# -- the moving picture ------------------------------------------------------------------------------------------------

LAST_BODY = 0.04
"""Length of the stub of a last body, by the robot's extent in motion: so short that no one takes it for a tool."""
PICTURE_RATE = 30.0
"""Pictures per second; fewer where a page would become too large.  A script interpolates between them."""
STILL = 1e-9
"""Movement, by the robot's extent, and turn, rad, below which a body counts as not moving: that is rounding."""


@dataclass(frozen=True)
class Scene:
    """A robot in motion, in the base frame."""

    mechanism: Mechanism
    time: Floats  # shape (N,), s
    q: Floats  # shape (N, n): of the trajectory's coordinates
    qd: Floats  # shape (N, n): of the trajectory's coordinates
    origins: Floats  # shape (N, bodies, 3): of the bodies' frames, m
    axes: Floats  # shape (N, bodies, 3): direction of each joint's first freedom; zero for joints that do not move
    tips: Floats  # shape (N, last bodies, 3): where drawings of the last bodies end, m
    last: tuple[int, ...]  # the last bodies
    still: npt.NDArray[np.bool_]  # shape (bodies,): bodies that do not move
    shapes: tuple[Shape, ...]  # of the robot, as far as they are drawn
    # shape (N, shapes, 2, 3): x and y axes of the frames of the bodies that carry the shapes
    turned: Floats
    up: Floats  # shape (3,): against gravity; z without gravity
    extent: float  # size of what the robot's bodies sweep, m


def scene(found: ExcitingTrajectory) -> Scene:
    """Where everything is, picture by picture; an InputError if a length has no value."""
    mechanism, trajectory = found.base.mechanism, found.trajectory
    kinematics = Kinematics(mechanism)
    time = _times(trajectory.duration, len(mechanism.bodies))
    frames = kinematics.frames(positions_along(mechanism, trajectory, time))
    rotations, origins = frames[..., :3], frames[..., 3]
    cloud = np.vstack([origins.reshape(-1, 3), np.zeros((1, 3))])
    extent = float(np.linalg.norm(np.ptp(cloud, axis=0))) or 1.0
    carriers = {body.parent for body in mechanism.bodies}
    last = tuple(i for i in range(len(mechanism.bodies)) if i not in carriers)
    ends = [LAST_BODY * extent * ahead(mechanism, i, extent) for i in last]
    tips = np.stack(
        [
            origins[:, i] + rotations[:, i] @ end
            for i, end in zip(last, ends, strict=True)
        ],
        axis=1,
    )
    moved = np.ptp(origins, axis=0).max(axis=1) / extent + np.ptp(
        rotations, axis=0
    ).max(axis=(1, 2))
    axes = joint_axes(mechanism, rotations, known_values(mechanism))
    q, qd = trajectory(time), trajectory(time, 1)
    shapes = tuple(
        shape
        for shape in found.shapes
        if not shape.obstacle and shape.kind is not ShapeKind.MESH
    )
    fixed = np.broadcast_to(np.eye(3), (len(time), 1, 3, 3))
    # the last frame is the base's, at index −1
    carried = np.concatenate([rotations, fixed], axis=1)[:, [s.body for s in shapes]]
    return Scene(
        mechanism,
        time,
        q,
        qd,
        origins,
        axes,
        tips,
        last,
        moved < STILL,
        shapes,
        np.swapaxes(carried[..., :2], -1, -2),
        upward(mechanism),
        extent,
    )


def robot(found: ExcitingTrajectory) -> tuple[Context, dict[str, Any] | None]:
    """Context of the section with the moving robot, and its JSON-able frames; None where a length has no value."""
    try:
        view = scene(found)
    except EchelonError as error:
        return {"problem": str(error)}, None
    return _context(found, view), _pictures(found, view)


def _context(found: ExcitingTrajectory, view: Scene) -> Context:
    return {
        "problem": "",
        "below": _said(found, "room"),
        "still": [
            body.name
            for body, still in zip(view.mechanism.bodies, view.still, strict=True)
            if still
        ],
        "floats": not view.mechanism.gravity,
        "shaped": bool(view.shapes),
        "begins": _said(found, "beginning"),
        "coordinates": list(
            zip(found.trajectory.coordinates, found.trajectory.units, strict=True)
        ),
    }


def _pictures(found: ExcitingTrajectory, view: Scene) -> dict[str, Any]:
    bodies = [
        {
            "name": one_line(body.name),
            "parent": body.parent,
            "joint": _kind(body),
            "still": bool(still),
            "last": view.last.index(i) if i in view.last else None,
        }
        for i, (body, still) in enumerate(
            zip(view.mechanism.bodies, view.still, strict=True)
        )
    ]
    points = np.vstack(
        [view.origins.reshape(-1, 3), view.tips.reshape(-1, 3), np.zeros((1, 3))]
    )
    arrays = {
        name: packed(getattr(view, name))
        for name in ("origins", "axes", "tips", "turned", "q", "qd")
    }

    def drawn(shape: Shape) -> dict[str, Any]:
        curves = [curve.round(4).tolist() for curve in outline(shape, view.extent)]
        return {"name": one_line(shape.name), "body": shape.body, "curves": curves}

    return {
        "bodies": bodies,
        "obstacles": [drawn(shape) for shape in found.shapes if shape.obstacle],
        "shapes": [drawn(shape) for shape in view.shapes],
        "pictures": len(view.time),
        "duration": float(view.time[-1]),
        "coordinates": [one_line(name) for name in found.trajectory.coordinates],
        "units": [one_line(unit) for unit in found.trajectory.units],
        "up": view.up.tolist(),
        "turn": widest_view(points / view.extent, view.up, PROPORTIONS.elevation),
        "elevation": PROPORTIONS.elevation,
        **arrays,
    }


def _times(duration: float, bodies: int) -> Floats:
    """Times of the pictures."""
    numbers = 3 * 3 * max(bodies, 1)  # origin, axis and tip of each
    most = int(PLOT_BYTES / 2 / (numbers * PACKED_NUMBER_BYTES))
    wanted = int(np.ceil(PICTURE_RATE * duration))
    return np.linspace(0.0, duration, min(wanted, most) + 1)


def _kind(body: Body) -> str:
    """How a joint is drawn."""
    kinds = [motion.kind for motion in body.joint.motions]
    if not kinds:
        return "fixed"
    return {MotionKind.TRANSLATION: "slide", MotionKind.SCREW: "screw"}.get(
        kinds[0], "turn"
    )
