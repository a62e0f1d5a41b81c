"""What was done to a mechanism so that its loops close exactly, and what its numbers nearly allow."""

from __future__ import annotations

import numpy as np

from echelon.arrays import Floats
from echelon.mechanism.closed_pose import as_stated
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.symbol_values import has_values
from echelon.regressor.loops.assembly import Assembly
from echelon.regressor.loops.closed_motion import RANK_TOLERANCE
from echelon.seeds import DEFAULT_SEED, random_generator

_NEARLY = 1e-2  # singular values below this part of the largest one belong to motions that are nearly possible
_STATES, _REACH = 8, 0.5


def closable_as_stated(mechanism: Mechanism) -> Mechanism:
    """The mechanism with the frames that were stated, if the loops close with them in doubles; otherwise as it is."""
    if not mechanism.closed_at:
        return mechanism
    stated = as_stated(mechanism)
    return stated if Assembly(stated).closes else mechanism


def closing_notes(mechanism: Mechanism) -> list[str]:
    """What a user should know of how the loops of a mechanism close."""
    if not mechanism.closures or not has_values(mechanism):
        return []
    assembly = Assembly(mechanism)
    notes = [_moved(mechanism, assembly)] if mechanism.closed_at else []
    return notes + _nearly_free(mechanism, assembly)


def _moved(mechanism: Mechanism, assembly: Assembly) -> str:
    """By how much frames were moved."""
    stated = Assembly(as_stated(mechanism))
    values, kinds = np.abs(stated.closures.at(assembly.pose[None])[0][0]), stated.closures.is_length
    lengths, angles = (float(values[kinds == kind].max(initial=0.0)) for kind in (True, False))
    return (
        f"the second frames of {_names(mechanism)} were moved by up to {lengths * stated.closures.length:.1g} m and "
        f"{angles:.1g} rad, so that the loops close exactly"
    )


def _nearly_free(mechanism: Mechanism, assembly: Assembly) -> list[str]:
    """Motions that the loops nearly allow."""
    states, _, _ = assembly.random_closed_states(random_generator(DEFAULT_SEED), _STATES, _REACH)
    sizes = _singular(assembly, np.vstack([assembly.pose[None], states]))
    near = sizes[(sizes > RANK_TOLERANCE) & (sizes < _NEARLY)]
    if not near.size:
        return []
    freedoms = len(mechanism.independent_velocities)
    more = "a motion" if len(near) == 1 else f"{len(near)} motions"
    return [
        f"the loops closed by {_names(mechanism)} nearly allow {more} (singular value {near.max():.1g} of their "
        f"equations): if rounding has locked them, the mechanism is meant to have {freedoms + len(near)} degrees of "
        f"freedom instead of {freedoms}; write directions and angles as expressions such as pi/3, lengths exactly"
    ]


def _singular(assembly: Assembly, q: Floats) -> Floats:
    """The largest of each singular value over some states, about the largest one."""
    jacobian = assembly.closures.at(q)[1][:, :, : len(assembly.mechanism.velocities)]
    found = np.linalg.svd(jacobian, compute_uv=False)
    largest: Floats = (found / found[:, :1]).max(axis=0)
    return largest


def _names(mechanism: Mechanism) -> str:
    return ", ".join(f"'{closure.name}'" for closure in mechanism.closures)
