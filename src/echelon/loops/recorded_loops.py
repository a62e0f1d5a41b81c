"""Closed states for recorded forms of a mechanism with loops, and random real states among them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from echelon.algebra import (
    DEFAULT_SEED,
    Scalar,
    StagedSchedule,
    random_generator,
    stated_ball,
)
from echelon.loops.assembly import FEW, NEARBY, POSES, TOGETHER, Assembly
from echelon.loops.closed_motion import REMEMBERED, Keyed, identity
from echelon.loops.closures import ClosureEquations, record_closures
from echelon.robot import (
    Mechanism,
    Probes,
    Recorder,
    all_symbols,
    state_inputs,
    value_texts,
)
from echelon.shared import DegenerateSampleError, Floats, InputError

FINENESS = 256
"""Random numbers are multiples of its inverse, so that they are short."""
_POOL_SEED = DEFAULT_SEED + 1
"""Seed of poses that show dependences; certificates draw others by their own seeds."""
SHARED_MOTIONS = 4
"""Motions that share a pose: more show little that is new where many bodies are alike."""


@dataclass(frozen=True)
class Loops:
    """Loop closures of recorded forms, with motions and random states that satisfy them."""

    mechanism: Mechanism
    equations: ClosureEquations
    # virtual velocities of some freedoms, by node; those of the others are the inputs v[...].  None where all are, and
    # every virtual motion that keeps the loops closed is wanted
    speeds: Mapping[str, int] | None

    @cached_property
    def values(self) -> Mapping[str, str]:
        """Exact values of all symbols as text: the stated ones, and random ones where none are stated."""
        return closing_values(self.mechanism)

    @cached_property
    def closing(self) -> StagedSchedule:
        """The closure equations and their derivatives."""
        equations = self.equations
        return StagedSchedule(
            equations.program, [*equations.equations, *equations.jacobian.values()]
        )

    @cached_property
    def driven(self) -> StagedSchedule:
        """The virtual velocities that are known."""
        return StagedSchedule(
            self.equations.program, list((self.speeds or {}).values())
        )

    def poses(self, rng: np.random.Generator, count: int) -> Floats:
        """Random closed poses in double precision at :attr:`values`, shape (count, positions)."""
        return self.assembly.random_closed_states(rng, count)[0]

    @cached_property
    def near_poses(self) -> Floats:
        """Some random closed poses that are near the assembly pose, shape (poses, positions)."""
        return self.assembly.random_closed_states(
            random_generator(DEFAULT_SEED), POSES, NEARBY
        )[0]

    def known_poses(self, first: int, count: int) -> Floats:
        """Some of a sequence of random closed poses that is drawn once, shape (count, positions)."""
        pool = _pool(
            Keyed((identity(self.mechanism), frozenset(self.values.items())), self)
        )
        while len(pool.poses) < first + count:
            pool.grow()
        return pool.poses[first : first + count]

    def next_to(self, poses: Floats) -> Floats:
        """Closed poses next to some that nearly are, shape (poses, positions)."""
        return self.assembly.closed(poses, iterations=FEW)[0]

    def followed(self, poses: Floats, symbols: Mapping[str, Floats]) -> Floats:
        """Closed poses at other values of the symbols, one for each pose, next to closed poses at :attr:`values`."""
        poses, done = self.assembly.at(symbols).closed(poses, iterations=FEW)
        if not done.all():
            raise DegenerateSampleError(
                "the loops do not close at these values of the symbols"
            )
        return poses

    @property
    def motions(self) -> int:
        """Motions through one pose that show about as much as motions through several, which take longer to close."""
        freedoms = self.mechanism.degrees_of_freedom
        return min(SHARED_MOTIONS, 1 + freedoms * (freedoms + 1) // 2)

    @cached_property
    def singular(self) -> bool:
        """Whether the mechanism has more freedoms at the assembly pose than nearby, so that assembly modes may meet."""
        at_pose, near = (
            self.assembly.mobility(q)
            for q in (self.assembly.pose[None], self.known_poses(0, POSES))
        )
        return bool(at_pose[0] > near.min())

    @cached_property
    def assembly(self) -> Assembly:
        """Closed configurations in double precision, at :attr:`values`."""
        return self.assembly_at(floats_of(self.values))

    def assembly_at(self, symbols: Mapping[str, float] | None) -> Assembly:
        """Closed configurations in double precision, at some values of the symbols."""
        return Assembly(self.mechanism, symbols, self.equations)


def loops_of(
    mechanism: Mechanism,
    recorder: Recorder,
    probes: Probes | None = None,
    speeds: Mapping[str, Scalar] | None = None,
) -> Loops:
    """Loop closures for forms that were recorded for a mechanism with loops."""
    nodes = (
        None if speeds is None else {name: speed.node for name, speed in speeds.items()}
    )
    return Loops(mechanism, record_closures(mechanism, recorder, probes), nodes)


def closing_values(mechanism: Mechanism) -> Mapping[str, str]:
    """Exact values of all symbols as text, at which the loops close: random ones where none are stated.

    Raises
    ------
    InputError
        If the loops close at none of the random values that are tried.
    """
    # also of symbols that the closures do not use, such as those of gravity
    part = (identity(mechanism), frozenset(all_symbols(mechanism)))
    return _closing_values(Keyed(part, mechanism))


class _Pool:
    """Random closed poses of a mechanism, more and more of them."""

    def __init__(self, loops: Loops) -> None:
        self._loops = loops
        self._rng = random_generator(_POOL_SEED)
        self.poses: Floats = np.zeros((0, len(loops.mechanism.positions)))

    def grow(self) -> None:
        """Draw as many poses as there are, or the first ones."""
        self.poses = np.vstack(
            [self.poses, self._loops.poses(self._rng, max(len(self.poses), TOGETHER))]
        )


@lru_cache(maxsize=REMEMBERED)
def _pool(known: Keyed[Loops]) -> _Pool:
    return _Pool(known.subject)


@lru_cache(maxsize=REMEMBERED)
def _closing_values(known: Keyed[Mechanism]) -> Mapping[str, str]:
    mechanism = known.subject
    stated = value_texts(mechanism, all_symbols(mechanism))
    unknown = sorted(all_symbols(mechanism) - stated.keys())
    if not unknown:
        return stated
    rng = random_generator(DEFAULT_SEED)
    for attempt in range(TOGETHER):
        drawn = dict(zip(unknown, _random_texts(rng, len(unknown)), strict=True))
        values = {**stated, **drawn}
        try:
            _ = Assembly(mechanism, floats_of(values)).pose
        except InputError:
            if attempt == TOGETHER - 1:
                raise
        else:
            return values
    raise AssertionError("unreachable")


def _random_texts(rng: np.random.Generator, count: int) -> Iterable[str]:
    """Multiples of half a step between 1/2 and 3/2."""
    drawn = rng.integers(FINENESS, 3 * FINENESS, size=count)
    return (f"{number}/{2 * FINENESS}" for number in drawn)


def floats_of(values: Mapping[str, str]) -> dict[str, float]:
    """Values of symbols, which are stated as text, in double precision."""
    return {name: float(stated_ball(text).mid()) for name, text in values.items()}


def real_inputs(
    mechanism: Mechanism, rng: np.random.Generator, count: int
) -> dict[str, Floats]:
    """Random closed states and values of symbols, by the names of program inputs."""
    values = floats_of(closing_values(mechanism))
    states = Assembly(mechanism, values).random_closed_states(rng, count)
    return {
        name: np.full(count, value) for name, value in values.items()
    } | state_inputs(mechanism, *states)
