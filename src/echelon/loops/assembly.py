"""Closed configurations of a mechanism with loops, in double precision.

From a guess, damped Gauss–Newton steps lead to a closed configuration near it.  A mechanism can often be assembled in
several ways, so configurations that belong to given independent coordinates are followed from the assembly pose in
steps that are small enough to stay on one of them.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from functools import cached_property, lru_cache

import numpy as np

from echelon.arrays import Flags, Floats, cut_at, one_thread, pivoted_qr
from echelon.errors import InputError
from echelon.exact.field import DEFAULT_SEED, random_generator
from echelon.loops.closed_motion import (
    NOISE,
    REMEMBERED,
    ClosedMotion,
    Known,
    largest,
    normalised,
    places,
    position_rates,
)
from echelon.loops.closures import ClosureEquations
from echelon.mechanism.assembled import Assembled, Moved, to_write
from echelon.mechanism.closed_pose import loop_motions, shown_loops, split_balls
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism

NEARLY_FREE = 1e-2
"""Singular values below this part of the largest one belong to motions that are nearly possible."""

_RESIDUAL = 1e-12  # of the characteristic length
_ENOUGH, _STILL = 1e-10, 1e-9  # the same after a step this small, where sines of multiples of angles cost digits
_ITERATIONS = 100
_LONGEST = 0.5  # of one Gauss–Newton step, rad or characteristic lengths
_FLOOR = 1e-12  # of the damping: the steps stay finite where constraints are redundant
STRIDE, _SHORTEST = 0.1, 1e-4  # of a step on the way to given coordinates, rad or characteristic lengths
_FEW = 8  # iterations for one such step; if these do not do, it is shortened
LARGEST_CORRECTION = 0.05  # of what its trend predicts; more may be a jump to another way of assembly
_FAR = 0.1  # beyond which poses may be nearer than a closed one, rad or lengths
_CLEAR = 10.0  # by how much what closures hold exceeds what rounding makes them resist
_SEEN = 8  # configurations that show which equations are independent
_TRIES, _NEAR = 64, 1.0  # disturbances of a pose that does not close, rad or characteristic lengths
_WALK, _FEWEST = 20, 4  # random strides from the assembly pose, and from it to states near it
_KEPT_AWAY = 0.25  # of the assembly pose's distance from singular configurations; more than a stride
_RATE = 2.0  # largest random velocity and acceleration
_DETERMINED, _MORE = 1e-5, 4  # smallest singular value of equations for dependent velocities; times the states, else
_ROUNDING = 1e-6  # of coordinates, up to which they count as not moved, rad or characteristic lengths


class OpenLoopsError(InputError):
    """What stays open near the assembly pose; the pose where it does least, and its size, rad or lengths."""

    def __init__(self, opening: str, written: str, pose: Floats, size: float) -> None:
        super().__init__(
            f"the loops do not close near the assembly pose: {opening} at best, at  {written};  check the lengths and "
            "frames there, or state an assembly pose near which the loops close"
        )
        self.pose, self.size = pose, size


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
        if mechanism.rounding:
            self.held, self._nearly = _held(Known(self._identity, self))
            self.closures = self.closures.with_rows(self.held)

    def at(self, symbols: Mapping[str, Floats]) -> Assembly:
        """The same mechanism at other values of its symbols, one for every configuration, in the same units."""
        other = Assembly.__new__(Assembly)
        other.__dict__ |= {name: value for name, value in vars(self).items() if name not in ("pose", "assembled")}
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
        return _nearest(Known(self._identity, self)).copy()

    @property
    def _identity(self) -> Hashable:
        """All that closed configurations depend on."""
        mechanism = self.mechanism
        values = (mechanism.symbols, mechanism.assembly, self.symbols or {})
        moving = (mechanism.bodies, mechanism.couplings, mechanism.closures, mechanism.rounding)
        return (*moving, *(frozenset(v.items()) for v in values))

    def independent_equations(self) -> tuple[Sequence[int], Floats]:
        """Equations that are independent for all that their last decimals say, the same in all configurations.

        Also the configuration in which all equations together are closed best.
        """
        rng, nearest = random_generator(DEFAULT_SEED), self.nearest()
        q = np.repeat(nearest[None], _SEEN, axis=0)
        for _ in range(_FEWEST):
            ahead = self._moved(q, _random_motion(rng, self._singular(q)[1], 2 * STRIDE))
            for _ in range(_FEW):
                ahead = self.step(ahead)
            closed = largest(self.closures.at(ahead)[0]) <= max(self.explained, _ENOUGH)
            q[closed] = ahead[closed]
        jacobian = self._jacobian(q)
        sizes = np.linalg.svd(jacobian, compute_uv=False)
        if sizes.max(initial=0.0) <= self.tolerance:  # rad or lengths, by rad or lengths that move
            idle = f"{shown_loops(self.mechanism)} hold nothing that can move: leave them out"
            raise InputError(idle, element="loops")
        rank = cut_at((sizes / sizes[:, :1]).max(axis=0), self.tolerance, NOISE, _CLEAR)
        order = pivoted_qr(jacobian.swapaxes(1, 2).reshape(-1, jacobian.shape[1]))[1]
        return sorted(order[:rank].tolist()), nearest

    def nearest(self) -> Floats:
        """The closed configuration nearest to the stated pose, found anew; see :attr:`pose`."""
        q, done = self.closed(self._stated[None])
        if not done[0] or self._distances(q)[0].max(initial=0.0) > _FAR:
            # a pose in which the links are in line leads nowhere or far, so disturbances of it are tried, too
            sizes = np.linspace(0.0, _NEAR if self.mechanism.assembly else np.pi, _TRIES)
            q, done = self.closed(self._disturbed(sizes[:, None]))
            q, done = np.vstack([q, self._nearly_closed()]), np.append(done, False)
        values = self.closures.at(q)[0]
        open_by, away = largest(values), np.linalg.norm(self._distances(q), axis=1)
        # where rounding has locked loops, none of these close near here, and some far away may
        near, rounded = away < _FAR, open_by <= max(self.explained, open_by.min())
        closed = next(choice for choice in (done & near, rounded & near, done, rounded) if choice.any())
        best = int(np.where(closed, away, np.inf).argmin())
        nearest: Floats = q[best]
        if not done[best] and open_by[best] > self.explained:
            raise OpenLoopsError(self.opening(nearest), self.written(nearest), nearest, float(open_by[best]))
        return nearest

    def _nearly_closed(self) -> Floats:
        """The stated pose after steps without motions that closures hardly resist, which rounding may have locked."""
        q, speeds = self._stated[None], len(self.mechanism.velocities)
        for _ in range(_FEW):
            values, jacobian = self.closures.at(q)
            change = -(np.linalg.pinv(jacobian[:, :, :speeds], rcond=NEARLY_FREE) @ values[:, :, None])[:, :, 0]
            q = self._moved(q, change * _LONGEST / max(float(largest(change)[0]), _LONGEST))
        return q

    def written(self, q: Floats) -> str:
        """What a description says of a configuration (positions,)."""
        return to_write(dict(zip(self.mechanism.positions, q.tolist(), strict=True)))

    def moving_pose(self) -> Floats | None:
        """The nearest of some closed configurations, found at random, that can move; None if none can."""
        q, done = self.closed(self._disturbed(np.pi))
        if not done.any():
            return None
        q, rng = q[done], random_generator(DEFAULT_SEED)
        ahead, done = self.closed(self._moved(q, _random_motion(rng, self._singular(q)[1], 2 * STRIDE)))
        gone = largest((ahead - q) / self.position_units) > STRIDE / 10  # not so where links are folded onto each other
        q = q[done & gone & (self.mobility(ahead) > 0)]
        if not len(q):
            return None
        nearest: Floats = q[np.linalg.norm(self._distances(q), axis=1).argmin()]
        return nearest

    def _disturbed(self, size: Floats | float) -> Floats:
        """The stated pose with random turns and slides of what is in loops, shape (tries, positions)."""
        change = size * random_generator(DEFAULT_SEED).uniform(-1.0, 1.0, (_TRIES, len(self.mechanism.velocities)))
        looped = loop_motions(self.mechanism)
        for motion, _, place in places(self.mechanism):
            change[:, place] *= motion.name in looped
        return self._moved(np.repeat(self._stated[None], _TRIES, axis=0), change)

    def easiest(self, q: Floats) -> tuple[str, str, float]:
        """Of the motions that a closed configuration does not allow, the one that closures resist least.

        Its coordinate that moves most, the closure that resists most, and its singular value about the largest one.
        """
        jacobian = self._jacobian(q[None])[0]
        _, singular, motions = np.linalg.svd(jacobian, full_matrices=False)
        stopped = max(int((singular > self.tolerance * singular[0]).sum()) - 1, 0)
        motion = motions[stopped]
        owner = self.closures.owners[int(np.abs(jacobian @ motion).argmax())]
        moved = self.mechanism.velocities[int(np.abs(motion).argmax())]
        return moved, owner, float(singular[stopped] / singular[0]) if singular[0] else np.inf

    @cached_property
    def assembled(self) -> Assembled | None:
        """What was moved from the stated assembly pose to :attr:`pose`; None if nothing but rounding."""
        mechanism = self.mechanism
        moved = []
        distances = self._distances(self.pose[None])[0].tolist()
        for (motion, _, _), relative in zip(places(mechanism), distances, strict=True):
            slides = motion.kind is MotionKind.TRANSLATION
            size, unit = (relative * self.closures.length, "m") if slides else (relative, "rad")
            moved.append(
                Moved(motion.name, size, unit, relative, not mechanism.assembly.keys().isdisjoint(motion.positions))
            )
        moved = sorted((m for m in moved if m.relative > max(_ROUNDING, self.explained)), key=lambda m: -m.relative)
        if not moved:
            return None
        pose = dict(zip(mechanism.positions, self.pose.tolist(), strict=True))
        return Assembled(tuple(moved), *self.widest(self._stated), pose)

    @cached_property
    def _stated(self) -> Floats:
        """The stated assembly pose, zero where it says nothing."""
        mechanism = self.mechanism
        upright = {m.positions[0]: 1.0 for m in mechanism.motions if m.kind is MotionKind.BALL}
        stated = np.array([mechanism.assembly.get(n, upright.get(n, 0.0)) for n in mechanism.positions])
        upright_pose: Floats = normalised(mechanism, stated[None])[0]
        return upright_pose

    def _distances(self, q: Floats) -> Floats:
        """How far each motion is from the stated pose, rad or characteristic lengths, shape (N, motions)."""
        found = []
        for motion, place, _ in places(self.mechanism):
            if motion.kind is MotionKind.BALL:
                chord = np.abs(q[:, place] @ self._stated[place])
                found.append(2 * np.arccos(np.minimum(chord, 1.0)))
            else:
                found.append(np.abs((q - self._stated) / self.position_units)[:, place.start])
        return np.stack(found, axis=1)

    def closed(self, q: Floats, held: Sequence[str] = (), iterations: int = _ITERATIONS) -> tuple[Floats, Flags]:
        """Closed configurations near guesses (N, positions), and which of them close; others get as near as they can.

        Held velocity coordinates do not move.
        """
        names = self.mechanism.velocities
        free = [k for k, name in enumerate(names) if name not in held]
        q, left, before = normalised(self.mechanism, q), np.arange(len(q)), np.full(len(q), np.inf)
        for iteration in range(iterations + 1):
            values, jacobian = self.closures.at(q[left])
            open_by = largest(values)
            # where a small step has changed little, digits do not suffice
            far = (open_by > _RESIDUAL) & ((open_by > _ENOUGH) | (open_by < before[left] / 2))
            left = left[far]
            if not len(left) or iteration == iterations:
                break
            change = np.zeros((len(left), len(names)))
            change[:, free] = _damped_steps(values[far], jacobian[far][:, :, free])
            before[left] = np.where(largest(change) < _STILL, open_by[far], np.inf)
            q[left] = self._moved(q[left], change)
        return q, ~np.isin(np.arange(len(q)), left)

    def step(self, q: Floats) -> Floats:
        """Configurations after one Gauss–Newton step towards closed ones, shape (N, positions)."""
        values, jacobian = self.closures.at(q)
        return self._moved(q, _damped_steps(values, jacobian[:, :, : len(self.mechanism.velocities)]))

    def opening_of(self, q: Floats) -> float:
        """What closure equations miss most in some configurations, rad or characteristic lengths."""
        return float(np.abs(self.closures.at(q)[0]).max(initial=0.0))

    def from_independent(self, q_independent: Floats) -> Floats:
        """Configurations (N, positions) at positions of the independent coordinates, followed from :attr:`pose`."""
        starts = np.repeat(self.pose[None], len(q_independent), axis=0)
        q, gone = self.followed(starts, q_independent, _SHORTEST)
        if (gone < 1).any():
            stuck = int(np.argmax(gone < 1))
            self._refuse(stuck, q[stuck], q_independent[stuck])
        return q

    def followed(self, start: Floats, wanted: Floats, shortest: float) -> tuple[Floats, Floats]:
        """Configurations on the straight ways from closed ones to independent positions, and the shares that were gone.

        A way is given up where its steps would be shorter than the shortest, rad or characteristic lengths.
        """
        q, places = start.copy(), self.independent_places
        begin, end = q[:, places], self._turned_towards(q[:, places], wanted)
        extent = np.maximum(largest((end - begin) / self.position_units[places]), STRIDE)
        gone, stride, trend = np.zeros(len(q)), STRIDE / extent, np.zeros_like(q)
        on = np.arange(len(q))
        while len(on):
            reached = np.minimum(gone[on] + stride[on], 1.0)[:, None]
            guess = q[on] + trend[on] * (reached - gone[on, None])
            guess[:, places] = (1 - reached) * begin[on] + reached * end[on]
            guess = normalised(self.mechanism, guess)
            found, done = self.near(guess)
            done &= largest((found - guess) / self.position_units) < LARGEST_CORRECTION
            trend[on[done]] = (found - q[on])[done] / (reached[:, 0] - gone[on])[done, None]
            q[on[done]], gone[on[done]] = found[done], reached[done, 0]
            stride[on] = np.where(done, np.minimum(1.5 * stride[on], STRIDE / extent[on]), stride[on] / 2)
            on = on[(gone[on] < 1) & (stride[on] * extent[on] >= shortest)]
        return q, gone

    def near(self, guess: Floats) -> tuple[Floats, Flags]:
        """Closed configurations near guesses, with the same independent positions; and which of them were found."""
        return self.closed(guess, self.mechanism.independent_velocities, _FEW)

    @cached_property
    def independent_places(self) -> list[int]:
        """Places of :attr:`independent_positions` among all positions."""
        return [self.mechanism.positions.index(name) for name in self.independent_positions]

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
        self, rng: np.random.Generator, count: int, reach: float = 1.0, motions: int = 1
    ) -> tuple[Floats, Floats, Floats]:
        """Random q, qd and qdd of all coordinates, of some motions at each configuration.

        Configurations are those of random walks from the assembly pose, which keep away from singular ones, so that
        they cannot change over to another way of assembly there.
        """
        q = np.repeat(self.pose[None], -(-count // motions), axis=0)
        (sizes, across), strides = self._singular(q), max(_FEWEST, round(_WALK * reach**2))
        size = 2 * STRIDE * reach * np.sqrt(_WALK / strides)  # as far on average, however many there are
        rank = len(self.mechanism.velocities) - int(self.mobility(self.pose[None])[0])
        smallest = max(rank - 1, 0)  # of the singular values that do not vanish at the assembly pose
        near = _KEPT_AWAY * sizes[0, smallest]
        for _ in range(strides):
            found, done = self.closed(self._moved(q, _random_motion(rng, across, size)), iterations=_FEW)
            sizes, ahead = self._singular(found)
            done &= sizes[:, smallest] >= near
            q[done], across[done] = found[done], ahead[done]
        q, across = (np.repeat(x, motions, axis=0)[:count] for x in (q, across))
        qd = _random_motion(rng, across, _RATE) * self.speed_units
        back = np.linalg.pinv(self._jacobian(q), rcond=self.tolerance) @ self.closures.bias(q, qd)[:, :, None]
        return q, qd, (_random_motion(rng, across, _RATE) - back[:, :, 0]) * self.speed_units

    def determined_states(
        self, rng: np.random.Generator, count: int, reach: float = 1.0, motions: int = 1
    ) -> tuple[Floats, Floats, Floats]:
        """Random closed states at which the independent coordinates determine the others, as far as there are some.

        Near poses at which they do not, as those of a Delta robot with parallel rods, more states are tried.
        """
        found = self.random_closed_states(rng, count, reach, motions)
        if self.determined(found[0]).min() > _DETERMINED:
            return found
        q, qd, qdd = self.random_closed_states(rng, _MORE * count, reach, motions)
        best = np.argsort(self.determined(q))[-count:]
        return q[best], qd[best], qdd[best]

    def _singular(self, q: Floats) -> tuple[Floats, Floats]:
        """Singular values of J, and orthonormal rows that span its rows, with zeros below them."""
        _, sizes, across = np.linalg.svd(self._jacobian(q), full_matrices=False)
        independent = sizes > self.tolerance * sizes[:, :1]
        return sizes, across * independent[:, :, None]

    def _moved(self, q: Floats, change: Floats) -> Floats:
        return normalised(self.mechanism, q + position_rates(self.mechanism, q, change * self.speed_units))

    @cached_property
    def position_units(self) -> Floats:
        """Units of the positions, shape (positions,): the characteristic length where they slide."""
        units = dict(zip(self.closures.freedoms, self.closures.units, strict=True))
        return np.array([units.get(name, 1.0) for name in self.mechanism.positions])

    def _turned_towards(self, begin: Floats, end: Floats) -> Floats:
        """Independent positions whose quaternions are on the side of those where the way begins; −q turns as q does."""
        result = end.copy()
        for motion in self.mechanism.motions:
            if motion.kind is MotionKind.BALL and motion.positions[0] in self.independent_positions:
                first = self.independent_positions.index(motion.positions[0])
                ball = slice(first, first + 4)
                away = (begin[:, ball] * end[:, ball]).sum(axis=1) < 0
                result[away, ball] *= -1
        return result

    def _refuse(self, sample: int, q: Floats, wanted: Floats) -> None:
        q[self.independent_places] = wanted
        nearest, done = self.closed(q[None], self.mechanism.independent_velocities)
        problem = "the way there from the assembly pose passes a singular configuration"
        if not done[0]:
            problem = self.opening(nearest[0])
        raise InputError(f"the loops cannot be closed at the independent positions of sample {sample}: {problem}")


@lru_cache(maxsize=REMEMBERED)
def _held(known: Known[Assembly]) -> tuple[Sequence[int], Floats]:
    return known.subject.independent_equations()


@lru_cache(maxsize=REMEMBERED)
def _nearest(known: Known[Assembly]) -> Floats:
    return known.subject.nearest()


def _random_motion(rng: np.random.Generator, across: Floats, size: float) -> Floats:
    """Random x with J x = 0, from orthonormal rows that span those of J."""
    any_ = rng.uniform(-size, size, across.shape[::2])
    result: Floats = any_ - (across.swapaxes(1, 2) @ (across @ any_[:, :, None]))[:, :, 0]
    return result


def _damped_steps(values: Floats, jacobian: Floats) -> Floats:
    """Levenberg–Marquardt steps; the damping follows the square of the error, so the end is quadratic."""
    transposed = jacobian.swapaxes(1, 2)
    square = transposed @ jacobian
    damping = (values**2).sum(axis=1) + _FLOOR * np.maximum(1.0, np.abs(square).max(axis=(1, 2), initial=0.0))
    normal = square + damping[:, None, None] * np.eye(jacobian.shape[2])
    steps: Floats = -np.linalg.solve(normal, transposed @ values[:, :, None])[:, :, 0]
    return steps * np.minimum(1.0, _LONGEST / np.maximum(largest(steps), 1e-300))[:, None]
