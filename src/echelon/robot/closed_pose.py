"""Which motions, bodies and closures belong together in loops."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from echelon.robot.closure import Closure
from echelon.robot.joint import GROUND
from echelon.robot.mechanism import Mechanism
from echelon.shared import listed


def loop_motions(
    mechanism: Mechanism, closures: Sequence[Closure] | None = None
) -> set[str]:
    """Names of the motions that all loops or those of some closures involve, of leaders instead of coupled ones."""
    closures = mechanism.closures if closures is None else closures
    bodies = {
        body
        for closure in closures
        for chain in ends_of(mechanism, closure)
        for body in chain
    }
    names = {
        motion.name
        for body in bodies
        for motion in mechanism.bodies[body].joint.motions
    }
    leaders = {c.coordinate: {name for name, _ in c.terms} for c in mechanism.couplings}
    return {leader for name in names for leader in leaders.get(name, {name})}


def shown_loops(mechanism: Mechanism, coordinate: str | None = None) -> str:
    """The loops, or those that a coordinate moves in, by their closures and bodies; of many, the first ones."""
    motion = next(
        (m.name for m in mechanism.motions if coordinate in m.velocities), None
    )
    through = [
        c for c in mechanism.closures if motion in loop_motions(mechanism, [c])
    ] or mechanism.closures
    closures = [f"'{c.name}' ({mechanism.ends(c.name)})" for c in through]
    return f"the loops closed by {listed(closures)}"


def split_balls(mechanism: Mechanism) -> list[str]:
    """Independent coordinates of balls of which other components depend on them."""
    chosen = set(mechanism.independent_velocities)
    split = [
        motion
        for motion in mechanism.motions
        if not chosen.issuperset(motion.velocities)
    ]
    return [name for motion in split for name in motion.velocities if name in chosen]


def ends_of(mechanism: Mechanism, closure: Closure) -> tuple[list[int], list[int]]:
    """The bodies between each end of a closure and what carries both, the outermost first."""
    return parted(
        closure.first, closure.second, lambda body: mechanism.bodies[body].parent
    )


def parted(
    first: int, second: int, parent: Callable[[int], int]
) -> tuple[list[int], list[int]]:
    """Two members of a tree, each with those that carry it up to where they meet, outward."""
    chains: tuple[list[int], list[int]] = ([], [])
    for chain, member in zip(chains, (first, second), strict=True):
        while member != GROUND:
            chain.append(member)
            member = parent(member)
    while all(chains) and chains[0][-1] == chains[1][-1]:
        for chain in chains:
            chain.pop()
    return chains
