"""Closed configurations of a mechanism with loops, in double precision.

From a guess, damped Gauss–Newton steps lead to a closed configuration near it.  A mechanism can often be assembled in
several ways, so configurations that belong to given independent coordinates are followed from the assembly pose in
steps that are small enough to stay on one of them.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from copy import copy
from functools import cached_property, lru_cache

import numpy as np

from echelon.algebra import DEFAULT_SEED, random_generator
from echelon.loops.closed_motion import (
    CLEAR,
    CLOSED,
    NOISE,
    RATE,
    REMEMBERED,
    ClosedMotion,
    Keyed,
    identity,
    largest,
    normalised,
    places,
    position_rates,
)
from echelon.loops.closures import ClosureEquations
from echelon.robot import (
    Assembled,
    Mechanism,
    MotionKind,
    Moved,
    loop_motions,
    shown_loops,
    split_balls,
    to_write,
)
from echelon.shared import Flags, Floats, InputError, cut_at, one_thread, pivoted_qr

NEARLY_FREE = 1e-2
"""Singular values below this part of the largest one belong to motions that are nearly possible."""

STRIDE = 0.1
"""Longest step that stays on one way of assembly, rad or characteristic lengths; random moves go up to twice as far."""

LARGEST_CORRECTION = STRIDE / 2
"""Of what the trend of some steps predicts; a larger one may be a jump to another way of assembly."""

FEW = 8
"""Gauss–Newton steps that lead from what is nearly closed to closed configurations, if anything does."""

POSES = 8
"""Random closed configurations that show together what is so in nearly all."""

NEARBY = 4
"""Random moves that stay near the assembly pose, where what rounding opens has hardly grown."""

TOGETHER = 64
"""Random configurations that are drawn at once, which takes little longer than to draw one."""

ITERATIONS = 100
"""Gauss–Newton steps that lead from anywhere to a closed configuration."""

NEAR = 1.0
"""Distance from a stated pose, rad or characteristic lengths, within which the closed pose is the one that is meant."""

FALL = 10.0
"""Factor by which singular values that closures hold exceed those that rounding makes."""

WALK = 20
"""Random moves from the assembly pose to a random configuration."""


class Assembly(ClosedMotion):
    """Closed configurations, and motion there.

    Where numbers are rounded, redundant equations contradict one another: independent ones are held, and the others to
    what rounding explains.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        symbols: Mapping[str, float] | None = None,
        equations: ClosureEquations | None = None,
    ) -> None:
        super().__init__(mechanism, symbols, equations)
        self.held: Sequence[int] = self.closures.rows
        self._nearly: Floats | None = None  # where rounded equations are closed best
        self._left_open = self.explained  # by equations that contradict one another
        if mechanism.rounding:
            self.held, self._nearly = _held(Keyed(self._identity, self))
            self.closures, self._left_open = self.closures.with_rows(self.held), 0.0

    def at(self, symbols: Mapping[str, Floats]) -> Assembly:
        """Copy at other values of the symbols, one for every configuration, in the units of this one."""
        other = copy(self)
        for name in {"pose", "assembled"} & vars(self).keys():
            delattr(other, name)
        other.closures, other.symbols = self.closures.with_values(symbols), None
        return other

    # -- configurations --------------------------------------------------------------------------------------------

    @cached_property
    def pose(self) -> Floats:
        """The closed configuration nearest to the mechanism's assembly pose that is found, shape (positions,).

        Gauss–Newton steps from there come first, which are the shortest that close the loops to first order.
        """
        if self._nearly is not None:
            nearest: Floats = self.closed(self._nearly[None])[0][0]
            return nearest
        return _nearest(Keyed(self._identity, self)).copy()

    @property
    def _identity(self) -> Hashable:
        """All that closed configurations depend on."""
        return identity(self.mechanism), frozenset((self.symbols or {}).items())

    def independent_equations(self) -> tuple[Sequence[int], Floats]:
        """Equations that are independent for all that their last decimals say, the same in all configurations.

        Also the configuration in which all equations together are closed best.
        """
        nearest = self.nearest()
        jacobian = self.jacobian(
            self._walked(random_generator(DEFAULT_SEED), nearest, POSES, NEARBY)[0]
        )
        sizes = np.linalg.svd(jacobian, compute_uv=False)
        if (
            sizes.max(initial=0.0) <= self.tolerance
        ):  # rad or lengths, by rad or lengths that move
            idle = f"{shown_loops(self.mechanism)} constrain no joint: leave them out"
            raise InputError(idle, element="loops")
        rank = cut_at((sizes / sizes[:, :1]).max(axis=0), self.tolerance, NOISE, FALL)
        order = pivoted_qr(jacobian.swapaxes(1, 2).reshape(-1, jacobian.shape[1]))[1]
        return sorted(order[:rank].tolist()), nearest

    def nearest(self) -> Floats:
        """The closed configuration nearest to the stated pose, found anew; see :attr:`pose`."""
        q, done = self.closed(self._stated[None])
        if not done[0] or self._distances(q).max(initial=0.0) > STRIDE:
            # a pose in which the links are in line leads nowhere or far, so disturbances of it are tried, too
            farthest = NEAR if self.mechanism.assembly else np.pi
            q, _ = self.closed(
                self._disturbed(np.linspace(0.0, farthest, TOGETHER)[:, None])
            )
            q = np.vstack([q, self._nearly_closed()])
        values = self.closures.at(q)[0]
        open_by, away = largest(values), np.linalg.norm(self._distances(q), axis=1)
        enough = max(CLOSED, self._left_open)
        best = int(
            np.where(open_by <= max(enough, open_by.min()), away, np.inf).argmin()
        )
        nearest: Floats = q[best]
        if open_by[best] > enough:
            raise InputError(
                f"the loops do not close near the assembly pose: {self.opening(nearest)} at best, at  "
                f"{self.written(nearest)};  check the lengths and frames there, or state an assembly pose near which "
                "the loops close"
            )
        return nearest

    def _nearly_closed(self) -> Floats:
        """The stated pose after steps without motions that closures hardly resist, which rounding may have locked."""
        q = self._stated[None]
        for _ in range(FEW):
            across = np.linalg.pinv(self.jacobian(q), rcond=NEARLY_FREE)
            change = -(across @ self.closures.at(q)[0][:, :, None])[:, :, 0]
            q = self._moved(
                q, change / np.maximum(2 * largest(change), 1.0)
            )  # no longer than damped steps are
        return q

    def written(self, q: Floats) -> str:
        """Text that states a configuration (positions,) in a description."""
        return to_write(dict(zip(self.mechanism.positions, q.tolist(), strict=True)))

    def moving_pose(self) -> Floats | None:
        """The nearest of some closed configurations, found at random, that can move; None if none can."""
        q, done = self.closed(self._disturbed(np.pi))
        q, rng = q[done], random_generator(DEFAULT_SEED)
        ahead, done = self.closed(
            self._moved(q, _random_motion(rng, self._singular(q)[1], 2 * STRIDE))
        )
        gone = (
            largest((ahead - q) / self.position_units) > STRIDE / 10
        )  # not so where links are folded onto each other
        q = q[done & gone & (self.mobility(ahead) > 0)]
        if not len(q):
            return None
        nearest: Floats = q[np.linalg.norm(self._distances(q), axis=1).argmin()]
        return nearest

    def _disturbed(self, size: Floats | float) -> Floats:
        """The stated pose with random turns and slides of what is in loops, shape (tries, positions)."""
        change = size * random_generator(DEFAULT_SEED).uniform(
            -1.0, 1.0, (TOGETHER, len(self.mechanism.velocities))
        )
        looped = loop_motions(self.mechanism)
        for motion, _, place in places(self.mechanism):
            change[:, place] *= motion.name in looped
        return self._moved(np.repeat(self._stated[None], TOGETHER, axis=0), change)

    def easiest(self, q: Floats) -> tuple[str, str, float]:
        """Forbidden motion that the closures resist least at a closed configuration.

        Its coordinate that moves most, the closure that resists most, and its singular value about the largest one.
        """
        jacobian = self.jacobian(q[None])[0]
        _, singular, motions = np.linalg.svd(jacobian, full_matrices=False)
        stopped = max(int((singular > self.tolerance * singular[0]).sum()) - 1, 0)
        motion = motions[stopped]
        owner = self.closures.owners[int(np.abs(jacobian @ motion).argmax())]
        moved = self.mechanism.velocities[int(np.abs(motion).argmax())]
        return (
            moved,
            owner,
            float(singular[stopped] / singular[0]) if singular[0] else np.inf,
        )

    @cached_property
    def assembled(self) -> Assembled | None:
        """Moves from the stated assembly pose to :attr:`pose`; None if there are none beyond rounding."""
        mechanism, moved = self.mechanism, []
        distances = self._distances(self.pose[None])[0].tolist()
        for motion, relative in zip(mechanism.free_motions, distances, strict=True):
            slides = motion.kind is MotionKind.TRANSLATION
            size, unit = (
                (relative * self.closures.length, "m") if slides else (relative, "rad")
            )
            if relative > self.tolerance:
                stated = not mechanism.assembly.keys().isdisjoint(motion.positions)
                moved.append(Moved(motion.name, size, unit, relative, stated))
        if not moved:
            return None
        moved.sort(key=lambda m: -m.relative)
        pose = dict(zip(mechanism.positions, self.pose.tolist(), strict=True))
        return Assembled(tuple(moved), *self.widest(self._stated), pose)

    @cached_property
    def _stated(self) -> Floats:
        """The stated assembly pose, zero where it says nothing."""
        mechanism = self.mechanism
        upright = {
            m.positions[0]: 1.0 for m in mechanism.motions if m.kind is MotionKind.BALL
        }
        stated = np.array(
            [
                mechanism.assembly.get(n, upright.get(n, 0.0))
                for n in mechanism.positions
            ]
        )
        upright_pose: Floats = normalised(mechanism, stated[None])[0]
        return upright_pose

    def _distances(self, q: Floats) -> Floats:
        """Distance of each motion from the stated pose, rad or characteristic lengths, shape (N, motions)."""
        found = []
        for motion, place, _ in places(self.mechanism):
            if motion.kind is MotionKind.BALL:
                chord = np.abs(q[:, place] @ self._stated[place])
                found.append(2 * np.arccos(np.minimum(chord, 1.0)))
            else:
                found.append(
                    np.abs((q - self._stated) / self.position_units)[:, place.start]
                )
        return np.stack(found, axis=1)

    def closed(
        self, q: Floats, held: Sequence[str] = (), iterations: int = ITERATIONS
    ) -> tuple[Floats, Flags]:
        """Closed configurations near guesses (N, positions), and which of them close; others get as near as they can.

        Steps end where what is left open is rounding, or no longer falls.  Held coordinates do not move.
        """
        names = self.mechanism.velocities
        free = [k for k, name in enumerate(names) if name not in held]
        q, left, open_by = (
            normalised(self.mechanism, q),
            np.arange(len(q)),
            np.full(len(q), np.inf),
        )
        for iteration in range(iterations + 1):
            values, jacobian = self.closures.at(q[left], left)
            now = largest(values)
            far = (now > CLOSED) | ((now > NOISE) & (now < open_by[left]))
            open_by[left] = now
            left = left[far]
            if not len(left) or iteration == iterations:
                break
            change = np.zeros((len(left), len(names)))
            change[:, free] = _damped_steps(values[far], jacobian[far][:, :, free])
            q[left] = self._moved(q[left], change)
        return q, ~np.isin(np.arange(len(q)), left)

    def from_independent(self, q_independent: Floats) -> Floats:
        """Configurations (N, positions) at positions of the independent coordinates, followed from :attr:`pose`."""
        starts = np.repeat(self.pose[None], len(q_independent), axis=0)
        q, gone = self.followed(starts, q_independent, CLEAR * STRIDE)
        if (gone < 1).any():
            sample = int(np.argmax(gone < 1))
            q[:, self.independent_places] = q_independent
            there, done = self.closed(
                q[[sample]], self.mechanism.independent_velocities
            )
            problem = (
                "the way there from the assembly pose passes a singular configuration"
            )
            if not done[0]:
                problem = self.opening(there[0])
            raise InputError(
                f"the loops cannot be closed at the independent positions of sample {sample}: {problem}"
            )
        return q

    def followed(
        self, start: Floats, wanted: Floats, shortest: float
    ) -> tuple[Floats, Floats]:
        """Configurations on the straight ways from closed ones to independent positions, and the shares that were gone.

        A way is given up where its steps would be shorter than the shortest, rad or characteristic lengths.
        """
        q, places = start.copy(), self.independent_places
        begin, end = q[:, places], self._towards(q, wanted)
        longest = STRIDE / np.maximum(
            largest((end - begin) / self.position_units[places]), STRIDE
        )
        gone, stride, trend = np.zeros(len(q)), longest.copy(), np.zeros_like(q)
        on = np.arange(len(q))
        while len(on):
            reached = np.minimum(gone[on] + stride[on], 1.0)[:, None]
            step = reached - gone[on, None]
            guess = q[on] + trend[on] * step
            guess[:, places] = (1 - reached) * begin[on] + reached * end[on]
            guess = normalised(self.mechanism, guess)
            found, done = self.near(guess)
            done &= largest((found - guess) / self.position_units) < LARGEST_CORRECTION
            moved = on[done]
            trend[moved] = (found - q[on])[done] / step[done]
            q[moved], gone[moved] = found[done], reached[done, 0]
            stride[on] = np.where(
                done, np.minimum(1.5 * stride[on], longest[on]), stride[on] / 2
            )
            on = on[(gone[on] < 1) & (stride[on] * STRIDE >= shortest * longest[on])]
        return q, gone

    def near(self, guess: Floats) -> tuple[Floats, Flags]:
        """Closed configurations near guesses, with the same independent positions; and which of them were found."""
        return self.closed(guess, self.mechanism.independent_velocities, FEW)

    @cached_property
    def independent_places(self) -> list[int]:
        """Places of :attr:`independent_positions` among all positions."""
        return [
            self.mechanism.positions.index(name) for name in self.independent_positions
        ]

    @cached_property
    def independent_positions(self) -> tuple[str, ...]:
        """Names of the positions that belong to the independent coordinates."""
        if split := split_balls(self.mechanism):
            raise InputError(
                f"'{split[0]}' is one velocity of a free rotation, to which no position belongs: give the positions of "
                f"all coordinates ({', '.join(self.mechanism.positions)})"
            )
        return self.mechanism.independent_positions

    # -- states ----------------------------------------------------------------------------------------------------

    @one_thread()
    def random_closed_states(
        self, rng: np.random.Generator, count: int, moves: int = WALK, motions: int = 1
    ) -> tuple[Floats, Floats, Floats]:
        """Random q, qd and qdd of all coordinates, of some motions at each configuration.

        Configurations are those of random walks from the assembly pose, which keep away from singular ones, so that
        they cannot change over to another way of assembly there.
        """
        q, across = self._walked(rng, self.pose, -(-count // motions), moves)
        q, across = (np.repeat(x, motions, axis=0)[:count] for x in (q, across))
        qd = _random_motion(rng, across, RATE) * self.speed_units
        back = (
            np.linalg.pinv(self.jacobian(q), rcond=self.tolerance)
            @ self.closures.bias(q, qd)[:, :, None]
        )
        return (
            q,
            qd,
            (_random_motion(rng, across, RATE) - back[:, :, 0]) * self.speed_units,
        )

    def determined_states(
        self, rng: np.random.Generator, count: int, motions: int = 1
    ) -> tuple[Floats, Floats, Floats]:
        """Random closed states at which the independent coordinates determine the others, as far as there are some.

        Near poses at which they do not, as those of a Delta robot with parallel rods, the better half of twice as many.
        """
        found = self.random_closed_states(rng, count, motions=motions)
        if self.determined(found[0]).min() > CLEAR:
            return found
        q, qd, qdd = self.random_closed_states(rng, 2 * count, motions=motions)
        best = np.argsort(self.determined(q))[-count:]
        return q[best], qd[best], qdd[best]

    def _walked(
        self, rng: np.random.Generator, start: Floats, count: int, moves: int
    ) -> tuple[Floats, Floats]:
        """Ends of random walks from a closed configuration, and orthonormal rows that span those of J there.

        Moves that lead nearer to singular ones, for the start's distance, than a move and its correction are left out.
        """
        q = np.repeat(start[None], count, axis=0)
        sizes, across = self._singular(q)
        smallest = max(
            int(across[0].any(axis=1).sum()) - 1, 0
        )  # of those that do not vanish at the start
        near = (2 * STRIDE + LARGEST_CORRECTION) * sizes[0, smallest]
        for _ in range(moves):
            found, done = self.closed(
                self._moved(q, _random_motion(rng, across, 2 * STRIDE)), iterations=FEW
            )
            sizes, ahead = self._singular(found)
            done = (done | (largest(self.closures.at(found)[0]) <= self._left_open)) & (
                sizes[:, smallest] >= near
            )
            q[done], across[done] = found[done], ahead[done]
        return q, across

    def _singular(self, q: Floats) -> tuple[Floats, Floats]:
        """Singular values of J, and orthonormal rows that span its rows, with zeros below them."""
        _, sizes, across = np.linalg.svd(self.jacobian(q), full_matrices=False)
        independent = sizes > self.tolerance * sizes[:, :1]
        return sizes, across * independent[:, :, None]

    def _moved(self, q: Floats, change: Floats) -> Floats:
        return normalised(
            self.mechanism,
            q + position_rates(self.mechanism, q, change * self.speed_units),
        )

    @cached_property
    def position_units(self) -> Floats:
        """Units of the positions, shape (positions,): the characteristic length where they slide."""
        units = dict(zip(self.closures.freedoms, self.closures.units, strict=True))
        return np.array([units.get(name, 1.0) for name in self.mechanism.positions])

    def _towards(self, begin: Floats, wanted: Floats) -> Floats:
        """Independent positions whose quaternions are on the side of those where the way begins; −q turns as q does."""
        end = begin.copy()
        end[:, self.independent_places] = wanted
        for motion, place, _ in places(self.mechanism):
            if motion.kind is MotionKind.BALL:
                end[:, place] *= np.where(
                    (begin[:, place] * end[:, place]).sum(axis=1, keepdims=True) < 0,
                    -1,
                    1,
                )
        return end[:, self.independent_places]


@lru_cache(maxsize=REMEMBERED)
def _held(known: Keyed[Assembly]) -> tuple[Sequence[int], Floats]:
    return known.subject.independent_equations()


@lru_cache(maxsize=REMEMBERED)
def _nearest(known: Keyed[Assembly]) -> Floats:
    return known.subject.nearest()


def _random_motion(rng: np.random.Generator, across: Floats, size: float) -> Floats:
    """Random x with J x = 0, from orthonormal rows that span those of J."""
    any_ = rng.uniform(-size, size, across.shape[::2])
    result: Floats = (
        any_ - (across.swapaxes(1, 2) @ (across @ any_[:, :, None]))[:, :, 0]
    )
    return result


def _damped_steps(values: Floats, jacobian: Floats) -> Floats:
    """Levenberg–Marquardt steps; the damping follows the square of the error, so the end is quadratic.

    So no step is longer than 1/2 either.  A little damping stays where constraints are redundant.
    """
    transposed = jacobian.swapaxes(1, 2)
    square = transposed @ jacobian
    damping = (values**2).sum(axis=1) + NOISE * np.maximum(
        1.0, np.abs(square).max(axis=(1, 2), initial=0.0)
    )
    normal = square + damping[:, None, None] * np.eye(jacobian.shape[2])
    steps: Floats = -np.linalg.solve(normal, transposed @ values[:, :, None])[:, :, 0]
    return steps
