"""Rows to find structure from: forms whose null space is that of X, at the lowest cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from echelon.mechanism.mechanism import Mechanism
from echelon.regressor.energy import energy_form
from echelon.regressor.linear import LinearForms
from echelon.regressor.virtual_power import virtual_power_form


@dataclass(frozen=True)
class Rows:
    """Forms with some auxiliary columns before those of the parameters."""

    forms: LinearForms
    auxiliary: int  # 1 for energies, which are known up to a constant; 0 for forces

    def columns(self, keep: Sequence[int]) -> Rows:
        """The rows restricted to some parameters, renumbered in the given order."""
        chosen = [*range(self.auxiliary), *(self.auxiliary + column for column in keep)]
        return Rows(self.forms.columns(chosen), self.auxiliary)


def rows_of(mechanism: Mechanism) -> Rows:
    """The cheapest rows for what is measured.

    Energies serve while the forces of all independent coordinates are measured and only bodies have parameters; see
    :mod:`echelon.regressor.energy`.
    """
    if mechanism.measures_every_force and not mechanism.effects:
        return Rows(energy_form(mechanism), 1)
    return Rows(virtual_power_form(mechanism), 0)
