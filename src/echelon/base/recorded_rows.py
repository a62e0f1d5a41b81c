"""Other rows than forces: the total energy and its power, as linear forms in the standard parameters."""

from __future__ import annotations

from dataclasses import dataclass

from echelon.base.structure import find_structure
from echelon.errors import InputError
from echelon.mechanism.mechanism import Mechanism
from echelon.regressor.energy import energy_form
from echelon.regressor.linear import LinearForms
from echelon.regressor.virtual_power import power_form
from echelon.seeds import DEFAULT_SEED, random_generator


@dataclass(frozen=True)
class RecordedRows:
    """Rows that are linear in named parameters.

    Attributes
    ----------
    name : str
    forms : LinearForms
    auxiliary : int
        Leading columns that belong to no parameter: 1 for energies, which are known up to a constant.
    parameters : tuple of str
        Names of the columns after these.
    """

    name: str
    forms: LinearForms
    auxiliary: int
    parameters: tuple[str, ...]

    def __repr__(self) -> str:
        return f"RecordedRows({self.name}: {self.forms.shape[0]} × {len(self.parameters)})"


def energy_regressor(mechanism: Mechanism) -> RecordedRows:
    """The total mechanical energy, up to a constant, as a row in the standard parameters.

    Parameters
    ----------
    mechanism : Mechanism
        Without effects such as friction, which have no energy of their own.

    Returns
    -------
    RecordedRows

    Raises
    ------
    InputError
        If there are effects.
    """
    if mechanism.effects:
        names = ", ".join(effect.parameter for effect in mechanism.effects[:4])
        raise InputError(f"effects such as {names} have no energy: leave them out of the description")
    forms = _in_own_mode(mechanism, energy_form(mechanism))
    return RecordedRows(f"energy of {mechanism.name}", forms, 1, mechanism.parameters)


def power_regressor(mechanism: Mechanism) -> RecordedRows:
    """The power Σ force · velocity of all independent coordinates, as a row in the standard parameters.

    Parameters
    ----------
    mechanism : Mechanism

    Returns
    -------
    RecordedRows
    """
    forms = _in_own_mode(mechanism, power_form(mechanism))
    return RecordedRows(f"power of {mechanism.name}", forms, 0, mechanism.parameters)


def _in_own_mode(mechanism: Mechanism, forms: LinearForms) -> LinearForms:
    if not mechanism.closures:
        return forms
    return find_structure(mechanism, random_generator(DEFAULT_SEED)).on_curves(forms)
