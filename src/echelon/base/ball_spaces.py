"""What sensors of a mechanism with loops see, in ball arithmetic: bases of their row spaces at real closed states."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import flint
import numpy as np

from echelon.base.ball_relations import Elimination, Found, eliminated
from echelon.base.ball_rows import Balls
from echelon.base.near_pose import NearPose
from echelon.base.structure import find_structure
from echelon.errors import SingularPoseError
from echelon.mechanism.mechanism import Mechanism, Output
from echelon.regressor.linear_forms import Rows, virtual_power_form


@dataclass(frozen=True)
class BallSpaces:
    """A basis of every sensor's row space, (rank, base parameters of all sensors together), to some precision."""

    bases: Mapping[str, Balls]
    bits: int

    def rank(self, rows: Balls) -> int:
        """Dimension of what rows span.

        Raises
        ------
        SingularPoseError
            If the precision does not tell.
        """
        with flint.ctx.workprec(self.bits):
            found = Elimination(rows, self.bits).done(range(rows.shape[1]))
        if found is None:
            raise SingularPoseError("ball arithmetic does not tell what some sensors see together")
        return len(found.pivots)


def ball_spaces(
    mechanism: Mechanism,
    groups: Mapping[str, tuple[Output, ...]],
    rng: np.random.Generator,
    report: Callable[[str], None],
) -> BallSpaces:
    """What groups of outputs see near the pose at which the loops close, told of each that starts.

    Raises
    ------
    SingularPoseError
        If the loops are not proved to close, or no precision tells.
    """
    outputs = tuple(output for group in groups.values() for output in group)
    columns = find_structure(replace(mechanism, measured=outputs), rng).pivots
    near = dict[str, NearPose]()
    for name, group in groups.items():
        measured = replace(mechanism, measured=group)
        near[name] = NearPose(measured, Rows(virtual_power_form(measured), 0).columns(columns), columns)
    bases, precisions = dict[str, Balls](), list[int]()
    for name, pose in near.items():
        report(name)
        found, bits = eliminated(pose, len(columns), range(len(columns)))
        bases[name] = _basis(found)
        precisions.append(bits)
    return BallSpaces(bases, min(precisions))


def _basis(found: Found) -> Balls:
    """Rows that span all others: the identity in the columns of representatives."""
    rank, others = found.solution.shape
    basis = np.full((rank, rank + others), flint.arb(0), dtype=object)
    basis[range(rank), found.pivots] = flint.arb(1)
    basis[:, found.others] = found.solution
    return basis
