"""The loops of a mechanism for whoever records or moves it: None for a tree, which loads no file of theirs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from echelon.algebra import Program, Scalar
from echelon.robot import Mechanism, Probes, Recorder

if TYPE_CHECKING:
    from echelon.loops import Assembly, DependentMotion, Loops


def recorded_loops(
    recorder: Recorder,
    probes: Probes | None = None,
    chosen: Mapping[str, Scalar] | None = None,
) -> Loops | None:
    """Conditions under which recorded motions stay closed; None for mechanisms without loops."""
    if not recorder.mechanism.closures:
        return None
    from echelon.loops import loops_of

    return loops_of(recorder.mechanism, recorder, probes, chosen)


def dependent_motion(mechanism: Mechanism, program: Program) -> DependentMotion | None:
    """Rates of the dependent coordinates, recorded on a program."""
    if not mechanism.closures:
        return None
    from echelon.loops import DependentMotion

    return DependentMotion(mechanism, program)


def assembly_of(
    mechanism: Mechanism, symbols: Mapping[str, float] | None = None
) -> Assembly | None:
    """Closed configurations in double precision."""
    if not mechanism.closures:
        return None
    from echelon.loops import Assembly

    return Assembly(mechanism, symbols)


def joints_locked_by_loops(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of the joints that loops keep from moving; none of a tree."""
    if not mechanism.closures:
        return ()
    from echelon.loops import locked_joints

    return locked_joints(mechanism)
