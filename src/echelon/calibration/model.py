"""The error model of a robot and its measurements: rows that are linear in small errors, exactly and in doubles.

A row is the derivative of what is measured by the errors, at the nominal geometry.  So the combinations of errors that
measurements show are the base parameters of a linear model, found and certified like all others (Theorem 1).  Where a
measurement keeps the robot on a surface, or loops are closed, states are closed ones: each surface is a closure of a
copy of the robot, so that copies with independent states show together what the measurements show.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from echelon.algebra import (
    DEFAULT_SEED,
    FloatArithmetic,
    Polynomial,
    Program,
    Scalar,
    Schedule,
    Surd,
    as_polynomial,
    derivatives,
    with_values,
)
from echelon.base import LinearBase, base_parameters
from echelon.base import with_values as put_into
from echelon.calibration.errors import ErredRecorder, GeometryError
from echelon.calibration.frames import as_placement
from echelon.calibration.sights import USUAL_RADIUS, Nominal, Sight, SightRecorder
from echelon.dynamics import Kinematics, LinearModel
from echelon.loops import Loops, loops_of
from echelon.robot import (
    GROUND,
    IDENTITY,
    Body,
    Closure,
    ClosureKind,
    Joint,
    Mechanism,
    Placement,
    RecordedStep,
    Recorder,
    all_symbols,
    ball,
    has_values,
    in_numbers,
    known_values,
    placement_matrix,
    renamed,
    stated_values,
    symbol_values,
    value_texts,
)
from echelon.shared import (
    CalibrationErrors,
    Floats,
    InputError,
    independent_columns,
    symbol_stem,
)

ROUNDED = 6
"""Decimals of the nominal places of tools, m: a micrometre is far below what anybody calibrates to."""
NEGLIGIBLE = 1e-9
"""Part of a row that rounding may leave of one that follows from others."""
OTHER_MODE = 0.05
"""Share of a pose's slopes that a set may leave out: more than errors of a nominal geometry explain."""
ASSEMBLED = 12
"""Decimals of the frames of touched surfaces, so that they close at the pose that they were found at."""


@dataclass(frozen=True)
class ErrorModel:
    """A robot, what is measured of it, and which errors are looked for.

    Attributes
    ----------
    mechanism : Mechanism
    sights : tuple of Sight
    kinds : frozenset of str
        Errors that are looked for.
    """

    mechanism: Mechanism
    sights: tuple[Sight, ...]
    kinds: frozenset[CalibrationErrors]

    # -- doubles -----------------------------------------------------------------------------------------------------

    @cached_property
    def ends(self) -> tuple[str, ...]:
        """Names of all tools and outer frames, whose nominal places are numbers."""
        return tuple(
            dict.fromkeys(name for s in self.sights for name in (s.tool, s.frame))
        )

    @cached_property
    def _recorded(self) -> tuple[ErredRecorder, list[list[Scalar]]]:
        program = Program()
        recorder = ErredRecorder(self.mechanism, program, self.kinds)

        def nominal(name: str) -> RecordedStep:
            at = [program.input(f"f[{name},{k}]", "symbol") for k in range(12)]
            rows = [tuple(at[4 * i : 4 * i + 3]) for i in range(3)]
            return RecordedStep(tuple(rows), (at[3], at[7], at[11]))  # type: ignore[arg-type]

        seen = SightRecorder(recorder, self.sights, nominal)
        rows = [seen.rows(sight, frame) for sight, frame in seen.relative()]
        return recorder, rows

    @cached_property
    def errors(self) -> tuple[GeometryError, ...]:
        """All errors, in the order of the columns."""
        return tuple(self._recorded[0].errors.values())

    @cached_property
    def rows(self) -> tuple[slice, ...]:
        """Rows of each sight."""
        ends = np.cumsum([0, *(len(rows) for rows in self._recorded[1])]).tolist()
        return tuple(map(slice, ends[:-1], ends[1:]))

    @cached_property
    def _values(self) -> Schedule:
        recorder, recorded = self._recorded
        return Schedule(
            recorder.program, [row.node for rows in recorded for row in rows]
        )

    @cached_property
    def _slopes(self) -> dict[tuple[int, ...], tuple[list[tuple[int, int]], Schedule]]:
        return {}

    def _derivatives(
        self, columns: tuple[int, ...]
    ) -> tuple[list[tuple[int, int]], Schedule]:
        """Which entries depend on some errors, and their derivatives."""
        if columns not in self._slopes:
            recorder, recorded = self._recorded
            program, names = recorder.program, list(recorder.errors)
            values = [row.node for rows in recorded for row in rows]
            inputs = [program.input(names[k]).node for k in columns]
            backward = len(values) < len(inputs)
            found = derivatives(program, values, inputs, reverse=backward)
            self._slopes[columns] = list(found), Schedule(program, list(found.values()))
        return self._slopes[columns]

    @cached_property
    def _symbols(self) -> dict[str, float]:
        inputs = self._recorded[0].program.inputs.values()
        names = [i.name for i in inputs if i.role == "symbol" and "[" not in i.name]
        return symbol_values(self.mechanism, names)

    def _run(
        self,
        schedule: Schedule,
        q: Floats,
        errors: Floats,
        frames: Mapping[str, Floats],
    ) -> list[Floats]:
        """Values of a schedule at positions (N, n), each of shape (N,)."""
        program = self._recorded[0].program
        known: dict[str, Any] = dict(self._symbols)
        for name, column in zip(self.mechanism.positions, q.T, strict=True):
            known |= {f"q[{name}]": column, f"turned[{name}]": column}
        for error, value in zip(self._recorded[0].errors, errors, strict=True):
            known[error] = value
        for name in self.ends:
            entries = frames[name][:3].ravel()
            known |= {f"f[{name},{k}]": entry for k, entry in enumerate(entries)}
        leaves = {
            node: np.broadcast_to(np.asarray(known[program.inputs[node].name]), len(q))
            for node in schedule.leaves
        }
        return list(schedule.run(FloatArithmetic(), leaves, len(q)))

    def seen(self, q: Floats, errors: Floats, frames: Mapping[str, Floats]) -> Floats:
        """Rows of all sights, shape (N, rows), at positions (N, n) and errors (p,)."""
        return np.stack(self._run(self._values, q, errors, frames), axis=1)

    def slopes(
        self,
        q: Floats,
        errors: Floats,
        frames: Mapping[str, Floats],
        columns: Sequence[int] | None = None,
    ) -> Floats:
        """Derivatives of the rows by the errors, or by some of them, shape (N, rows, errors)."""
        chosen = tuple(range(len(self.errors)) if columns is None else columns)
        entries, schedule = self._derivatives(chosen)
        found = np.zeros((len(q), self.rows[-1].stop, len(chosen)))
        values = self._run(schedule, q, errors, frames)
        for (row, column), value in zip(entries, values, strict=True):
            found[:, row, column] = value
        return found

    # -- exactly -----------------------------------------------------------------------------------------------------

    def base(
        self,
        frames: Mapping[str, Floats] | None = None,
        poses: Floats | None = None,
        seed: int = DEFAULT_SEED,
    ) -> LinearBase:
        """Combinations of errors that the measurements show, in closed form and certified.

        Parameters
        ----------
        frames : mapping of str to array of shape (4, 4), optional
            Nominal places of tools on their bodies and of outer frames, near which the set holds.  By default tools
            are at the frames of their bodies, markers and centres of distances anywhere, and surfaces where random
            positions touch them.
        poses : array of shape (m, n), optional
            Positions at which all surfaces are touched; the set holds for all that motions reach from one of them.
        seed : int

        Returns
        -------
        LinearBase
        """
        return base_parameters(self.linear(frames or {}, poses, seed), seed=seed)

    def poses_of_other_modes(
        self, base: LinearBase, q: Floats, frames: Mapping[str, Floats]
    ) -> Floats:
        """Positions whose rows a set does not span, shape (0 or 1, n): those that do so the least.

        A set of touched surfaces holds for states that motions reach; other bends of the elbow may show more.
        """
        rows = self.slopes(q, np.zeros(len(self.errors)), frames)
        usual = np.array([e.usual if e.usual < np.inf else 1.0 for e in self.errors])
        spanned, _ = np.linalg.qr((base.B_float() * usual).T)
        rows = rows * usual
        left = rows - rows @ spanned @ spanned.T
        sizes = np.linalg.norm(rows, axis=(1, 2))
        beyond = np.linalg.norm(left, axis=(1, 2)) / sizes
        worst = int(np.argmax(beyond))
        return q[[worst]] if beyond[worst] > OTHER_MODE else q[:0]

    def linear(
        self,
        frames: Mapping[str, Floats],
        poses: Floats | None,
        seed: int = DEFAULT_SEED,
    ) -> LinearModel:
        """The rows as a linear model in the errors, at the nominal geometry."""
        program, rows = Program(), list[Scalar]()
        closed = [sight for sight in self.sights if sight.constrains]
        free = [sight for sight in self.sights if not sight.constrains]
        loops = [sight for sight in closed if sight.closure is not None]
        starts = [None] if poses is None else list(poses)
        groups = [([*free, *loops], None)] if free or loops else []
        groups += [
            ([sight], start)
            for sight in closed
            if sight.closure is None
            for start in starts
        ]
        if closed and not has_values(self.mechanism):
            silent = all_symbols(self.mechanism) - known_values(self.mechanism).keys()
            raise InputError(
                "loops and touched surfaces close at numbers only: give all symbols values",
                element=f"symbol '{min(silent)}'",
            )
        mechanism = in_numbers(self.mechanism) if closed else rational(self.mechanism)
        anywhere = {s.unplaced for s in free}
        found: list[Mechanism] = []
        recorders: list[ErredRecorder] = []
        for count, (sights, pose) in enumerate(groups):
            copy = copied(mechanism, f" ({count})" if count else "")
            recorder = ErredRecorder(copy, program, self.kinds)
            recorder.errors = recorders[0].errors if recorders else recorder.errors
            places = {
                name: as_placement(frame, ROUNDED) for name, frame in frames.items()
            }
            if sights[0].constrains and sights[0].closure is None:
                copy, places = touching(copy, sights[0], places, pose, seed)
            seen = SightRecorder(
                recorder,
                sights,
                _nominal(recorder, places, anywhere),
                rational=True,
            )
            for sight, frame in seen.relative():
                rows += seen.rows(sight, frame)
            found.append(copy)
            recorders.append(recorder)
        errors = recorders[0].errors
        inputs = [program.input(name).node for name in errors]
        nodes = [row.node for row in rows]
        slopes = derivatives(program, nodes, inputs, reverse=len(nodes) < len(inputs))
        put_in = dict.fromkeys(errors, Polynomial({}))
        at_zero, kept = with_values(program, list(slopes.values()), put_in)
        table = _independent_rows(
            at_zero, dict(zip(slopes, kept, strict=True)), len(inputs)
        )
        numbers, rng = stated_values(mechanism).numbers, np.random.default_rng(seed)
        constants = {
            i.name: _rational(numbers.get(i.name))
            for i in at_zero.inputs.values()
            if i.role == "symbol"
        }
        for name in sorted(
            constants.keys() - mechanism.symbols.keys()
        ):  # of places anywhere
            constants[name] = Fraction(int(rng.integers(100, 1000)), 1000)
        model = LinearModel.recorded(
            at_zero,
            table,
            {error.name: error.unit for error in errors.values()},
            constants,
            value_texts(
                mechanism, [n for n, value in constants.items() if value is None]
            ),
            f"geometry of {self.mechanism.name}",
        )
        if not closed:
            return model
        whole = merged(found)
        found_loops = loops_of(whole, Recorder(whole, at_zero))
        closing = PoseLoops(whole, found_loops.equations, None)
        model.regressor = replace(model.regressor, loops=closing)
        return model


class PoseLoops(Loops):
    """Closed states of rows that depend on positions only, so that each pose is worth one motion."""

    @property
    def motions(self) -> int:
        """One."""
        return 1


def _independent_rows(
    program: Program, entries: Mapping[tuple[int, int], int], columns: int
) -> list[list[Scalar]]:
    """Rows at one state of which none follows from the others, such as three of the nine of a rotation."""
    schedule = Schedule(program, list(entries.values()))
    drawn = np.random.default_rng(DEFAULT_SEED).uniform(0.2, 1.2, len(schedule.leaves))
    at = {
        node: np.array([value])
        for node, value in zip(schedule.leaves, drawn, strict=True)
    }
    values = schedule.run(FloatArithmetic(), at, 1)[:, 0]
    found = np.zeros((max(row for row, _ in entries) + 1, columns))
    for (row, column), value in zip(entries, values, strict=True):
        found[row, column] = value
    kept = {row: k for k, row in enumerate(independent_columns(found.T, NEGLIGIBLE))}
    table = [[program.zero] * columns for _ in kept]
    for (row, column), node in entries.items():
        if row in kept:
            table[kept[row]][column] = Scalar(program, node)
    return table


def rational(mechanism: Mechanism) -> Mechanism:
    """The robot with values for all symbols that are no rational numbers: angles in terms of their units."""
    values = stated_values(mechanism)
    roots = {name for name, value in values.numbers.items() if isinstance(value, Surd)}
    others = {*values.angles, *values.sums, *values.of_pi}
    found = (
        put_into(mechanism, values.put_in(roots | others))
        if roots | others
        else mechanism
    )
    return replace(found, symbols={**values.units, **found.symbols})


def _rational(value: object) -> int | Fraction | None:
    return value if isinstance(value, int | Fraction) else None


def _nominal(
    recorder: Recorder, places: Mapping[str, Placement], anywhere: Collection[str]
) -> Nominal:
    """Nominal places of ends: numbers, symbols for those that may be anywhere, or the frames of their bodies."""

    def step(name: str) -> RecordedStep | None:
        if name in places:
            return recorder.placement(places[name])
        if name not in anywhere:
            return None
        stem = symbol_stem(name)
        x, y, z = (recorder.program.input(f"{axis}{stem}", "symbol") for axis in "xyz")
        return RecordedStep(None, (x, y, z))

    return step


# -- copies of a robot -----------------------------------------------------------------------------------------------


def copied(mechanism: Mechanism, ending: str) -> Mechanism:
    """The robot under other names, which moves independently of the first."""
    if not ending:
        return mechanism

    bare = replace(mechanism, actuators=(), effects=(), measured=None, contacts=())
    return renamed(bare, lambda name: name + ending)


def merged(mechanisms: Sequence[Mechanism]) -> Mechanism:
    """Several robots as one."""
    bodies: list[Body] = []
    closures: list[Closure] = []
    for one in mechanisms:
        first = len(bodies)

        def moved(index: int, first: int = first) -> int:
            return index if index == GROUND else index + first

        bodies += [replace(body, parent=moved(body.parent)) for body in one.bodies]
        closures += [
            replace(c, first=moved(c.first), second=moved(c.second))
            for c in one.closures
        ]
    labelled = [
        replace(b, label=str(k), inertial=None) for k, b in enumerate(bodies, 1)
    ]
    return Mechanism(
        mechanisms[0].name,
        tuple(labelled),
        None,
        tuple(c for one in mechanisms for c in one.couplings),
        mechanisms[0].symbols,
        closures=tuple(closures),
        assembly={k: v for one in mechanisms for k, v in one.assembly.items()},
    )


def touching(
    mechanism: Mechanism,
    sight: Sight,
    places: Mapping[str, Placement],
    pose: Floats | None,
    seed: int,
) -> tuple[Mechanism, dict[str, Placement]]:
    """A copy of the robot that stays on what a sight touches, and where tool and outer frame are then."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(-1, 1, len(mechanism.positions)) if pose is None else pose
    at = np.round(at, ROUNDED)
    x, y, z = (as_polynomial(Fraction(str(v))) for v in sight.point)
    tool = places.get(sight.tool, Placement()) @ Placement(IDENTITY, (x, y, z))
    frames = Kinematics(mechanism).frames(at[None])[0]
    whole = {GROUND: np.eye(4)} | {
        k: np.vstack([frame, [0, 0, 0, 1]]) for k, frame in enumerate(frames)
    }
    seen = np.linalg.solve(
        whole[sight.on], whole[sight.body] @ placement_matrix(tool, {})
    )
    if sight.kind == "plane":
        seen[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        seen[:3, :3] *= np.linalg.det(seen[:3, :3])
    else:
        seen[:3, :3] = np.eye(3)
    given = places.get(sight.frame)
    radius = USUAL_RADIUS if sight.radius is None else sight.radius
    bar = np.zeros(3)
    if sight.kind in ("sphere", "distance"):
        direction = rng.normal(size=3)
        if given is not None:
            direction = seen[:3, 3] - placement_matrix(given, {})[:3, 3]
        bar = radius * direction / np.linalg.norm(direction)
        seen[:3, 3] -= bar
    elif given is not None:
        stated = placement_matrix(given, {})
        if sight.kind == "plane":  # moved along its normal alone
            normal = stated[:3, 2]
            height = normal @ (seen[:3, 3] - stated[:3, 3])
            seen[:3, 3] = stated[:3, 3] + height * normal
        seen[:3, :3] = stated[:3, :3]
    outer = as_placement(seen, ASSEMBLED)
    assembly = dict(mechanism.assembly) | dict(
        zip(mechanism.positions, at.tolist(), strict=True)
    )
    bodies, closures = list(mechanism.bodies), list(mechanism.closures)
    name = f"touch {sight.name}"
    if sight.kind in ("sphere", "distance"):
        far = as_placement(
            np.block([[np.eye(3), bar[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]),
            ASSEMBLED,
        )
        motion = ball(f"bar of {sight.name}")
        joint = Joint(f"bar of {sight.name}", "spherical", (outer, motion))
        label = f"bar_{symbol_stem(sight.name)}"
        bodies.append(Body(f"bar of {sight.name}", label, sight.on, joint, ()))
        closures.append(
            Closure(name, ClosureKind.SPHERICAL, len(bodies) - 1, sight.body, far, tool)
        )
    else:
        kind = (
            ClosureKind.POINT_ON_PLANE
            if sight.kind == "plane"
            else ClosureKind.SPHERICAL
        )
        closures.append(Closure(name, kind, sight.on, sight.body, outer, tool))
    closed = replace(
        mechanism,
        bodies=tuple(bodies),
        closures=tuple(closures),
        assembly=assembly,
        independent=(),
    )
    if not mechanism.positions:
        raise InputError("nothing moves", element=f"measure '{sight.name}'")
    return closed, {**places, sight.frame: outer}
