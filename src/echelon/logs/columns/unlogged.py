"""Joints of a robot that its log does not have: a gripper, a rail, a mobile base, the other arm.

Names of joints in the names of columns tell which ones are logged; else their number does: joints that are numbered
like the columns, or a run of as many joints along a chain.  What is left must look like what is bolted to an arm: it
slides, has several freedoms, is on another branch, or is called a gripper or a base.  The seventh joint of an arm does
not.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from echelon.logs.columns.column_names import Meaning
from echelon.mechanism.joint import GROUND, MotionKind
from echelon.mechanism.mechanism import Mechanism

_ATTACHED = re.compile(
    r"grip|finger|hand|thumb|claw|jaw|knuckle|tool|base|root|world|rail|track|wheel|caster|torso|lift|head|mobile|slide"
)
"""Parts of the names of joints that rest while an arm is identified."""
_NUMBER = re.compile(r"\d+(?=\D*$)")


def unlogged_joints(
    names: Sequence[str], meanings: Mapping[str, Meaning], known: Mapping[str, str], mechanism: Mechanism
) -> list[tuple[str, ...]]:
    """Sets of motions that a log may lack; several where nothing tells which."""
    motions = mechanism.free_motions
    told = {name for alias, name in known.items() if any(_says(column, alias) for column in names)}
    said = {m.name for m in motions if told & {m.name, *m.positions, *m.velocities}}
    if said:
        kept = [said]
    else:
        kept = next(filter(None, (list(_kept(mechanism, count)) for count in _counts(names, meanings))), [])
    return [tuple(m.name for m in motions if m.name not in some) for some in kept if len(some) < len(motions)]


def _says(column: str, alias: str) -> bool:
    return re.search(rf"(?<![A-Za-z0-9]){re.escape(alias)}(?![A-Za-z0-9])", column, re.IGNORECASE) is not None


def _counts(names: Sequence[str], meanings: Mapping[str, Meaning]) -> list[int]:
    """Numbers of joints that columns may be of: of numbered positions, else the size of families of columns."""
    numbers = {said.index for said in meanings.values() if said.kind in ("position", "joint")} - {None}
    if numbers:
        return [len(numbers)]
    sizes = Counter(_NUMBER.sub("#", name) for name in names if _NUMBER.search(name))
    return [size for size, families in Counter(sizes.values()).most_common() if families > 1]


def _kept(mechanism: Mechanism, count: int) -> Iterator[set[str]]:
    """Sets of motions that a log of so many joints may be of, of those that are as plausible the first of a chain."""
    chains = _chains(mechanism)
    stems: dict[str, set[str]] = {}
    for name in chains:
        stems.setdefault(_NUMBER.sub("#", name), set()).add(name)
    found = [some for stem, some in stems.items() if "#" in stem and len(some) == count]
    found = found or [set(chain[start : start + count]) for chain in chains.values() for start in range(len(chain))]
    found = [some for some in found if len(some) == count and _rests(mechanism, chains, some)]
    named = [sum(_ATTACHED.search(name.lower()) is not None for name in some) for some in found]
    yield from (some for k, some in enumerate(found) if named[k] == min(named) and some not in found[:k])


def _chains(mechanism: Mechanism) -> dict[str, list[str]]:
    """For every motion of a joint with one freedom, the motions of the joints from the base to it."""
    ways: dict[int, list[str]] = {GROUND: []}
    for k, body in enumerate(mechanism.bodies):
        own = [motion.name for motion in body.joint.motions if motion.name not in mechanism.dependent]
        ways[k] = ways[body.parent] + own
    return {way[-1]: way for way in ways.values() if way}


def _rests(mechanism: Mechanism, chains: Mapping[str, Sequence[str]], kept: set[str]) -> bool:
    """Whether all but some motions are of what is bolted to an arm, or on other branches."""
    along = {name for way in chains.values() if kept & set(way) for name in way}
    return all(
        motion.name in kept
        or motion.name not in along
        or _ATTACHED.search(motion.name.lower()) is not None
        or motion.kind is not MotionKind.ROTATION
        or len(body.joint.motions) > 1
        for body in mechanism.bodies
        for motion in body.joint.motions
    )
