"""Row spaces of a mechanism's sensors, from balls at real states."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import flint

from echelon.base.ball_tables import Balls
from echelon.base.elimination import eliminated
from echelon.base.real_states import RealStates
from echelon.dynamics import LinearForms, Rows
from echelon.shared import SingularPoseError


@dataclass(frozen=True)
class BallSpaces:
    """A basis of every sensor's row space, (rank, standard parameters), to some precision."""

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
            found = eliminated(rows, self.bits)
        if found is None:
            raise SingularPoseError(
                "ball arithmetic does not tell what rows of several models span together"
            )
        return len(found.pivots)


def spaces_of(
    forms: Mapping[str, LinearForms], report: Callable[[str], None]
) -> BallSpaces:
    """Bases of the row spaces of forms at the stated values of their symbols."""
    bases, bits = dict[str, Balls](), list[int]()
    samplers = {name: RealStates(Rows(form, 0)) for name, form in forms.items()}
    at = {
        symbol: text
        for sampler in samplers.values()
        for symbol, text in sampler.states.values.items()
    }
    for name, sampler in samplers.items():
        report(name)
        found = sampler.independent(at)
        bases[name] = found.basis
        bits.append(found.bits)
    return BallSpaces(bases, min(bits))
