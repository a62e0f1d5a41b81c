"""What is believed of torques before a trajectory is run: an identified model, or the inertial values of a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from echelon.base.derive import base_parameters
from echelon.errors import InputError
from echelon.excite.constraints.effort import effort_output
from echelon.excite.constraints.effort_bounds import EffortLimit
from echelon.excite.constraints.effort_model import EffortModel
from echelon.formats.schema_excite import ExcitationEntry
from echelon.identification.physics.prior import prior_from
from echelon.identification.settings import Setup
from echelon.logs.finding import Finding, Severity
from echelon.mechanism.mechanism import Mechanism
from echelon.results.identified import load_identified


def effort_model(
    setup: Setup, entry: ExcitationEntry, mechanism: Mechanism, limits: Sequence[EffortLimit]
) -> tuple[EffortModel | None, list[Finding]]:
    """The model that predicts efforts, and what is to be said about it.

    Parameters
    ----------
    setup : Setup
    entry : ExcitationEntry
    mechanism : Mechanism
        The set-up's, with what does not move held.
    limits : sequence of EffortLimit

    Returns
    -------
    EffortModel or None
        None where nothing predicts them.
    list of Finding

    Raises
    ------
    InputError
        If limits of efforts are stated and nothing predicts them, or the identified model is not one of this robot or
        does not determine them.
    """
    if entry.model is not None:
        return _identified(setup, entry, mechanism, limits), []
    return _standard(setup, entry, mechanism)


def _identified(
    setup: Setup, entry: ExcitationEntry, mechanism: Mechanism, limits: Sequence[EffortLimit]
) -> EffortModel:
    """Base parameters in the place of the pivots, with their covariance."""
    assert entry.model is not None
    found = load_identified(Path(setup.source).parent / entry.model)
    whole = base_parameters(setup.mechanism, seed=setup.settings.seed)
    ours, theirs = (tuple(map(str, base.expressions)) for base in (whole, found.base))
    if ours != theirs:
        problem = f"the model {entry.model} has other base parameters than this robot with its sensors"
        raise InputError(problem, source=setup.source, element="excitation.model")
    try:
        check_determined(setup.mechanism, limits, whole.rank, setup.settings.seed)
    except InputError as error:
        raise InputError(error.problem, source=setup.source, element="excitation.model") from None
    parameters = list(mechanism.parameters)
    columns = [parameters.index(setup.mechanism.parameters[pivot]) for pivot in whole.matrix.pivots]
    covariance = np.array(found.document["estimate"]["covariance"], dtype=float)
    return EffortModel(found.values, columns, covariance, entry.deviations)


def check_determined(mechanism: Mechanism, limits: Sequence[EffortLimit], rank: int, seed: int) -> None:
    """Refuse efforts that depend on more than the outputs see: their rows would add to the rank.

    Parameters
    ----------
    mechanism : Mechanism
    limits : sequence of EffortLimit
    rank : int
        Of the outputs.
    seed : int

    Raises
    ------
    InputError
        If one does.
    """
    efforts = (effort_output(mechanism, limit) for limit in limits)
    named = tuple(replace(output, name=f"effort of {output.name}") for output in efforts)
    both = replace(mechanism, measured=(*mechanism.outputs, *named), reading=None)
    if base_parameters(both, seed=seed).rank > rank:
        raise InputError("the identified model does not determine all torques and forces that are limited")


def _standard(setup: Setup, entry: ExcitationEntry, mechanism: Mechanism) -> tuple[EffortModel | None, list[Finding]]:
    """Standard parameters of the prior; friction without a value counts as none."""
    names = setup.mechanism.parameters
    if setup.prior is not None:
        whole = base_parameters(setup.mechanism, seed=setup.settings.seed)
        given = dict(zip(names, prior_from(whole, setup.prior).values.tolist(), strict=True))
    else:
        stated = zip(names, setup.mechanism.standard_values(), strict=True)
        given = {name: np.nan if value is None else value for name, value in stated}
    values = np.array([given[name] for name in mechanism.parameters])
    inertial = np.array([column.body is not None for column in mechanism.columns])
    if np.isnan(values[inertial]).any():
        if entry.limits.effort:
            problem = (
                "limits of torques need inertial values: state them, an identified model under excitation: model, "
            )
            raise InputError(
                problem + "or a file under identification: prior", source=setup.source, element="effort limits"
            )
        text = "torques are not limited, because the robot file states no inertial values to predict them with"
        return None, [Finding(Severity.WARNING, "effort", setup.source, text)]
    findings = []
    if np.isnan(values).any():
        text = "friction has no values in the prior model: it is left to the margin of the torque limits"
        findings.append(Finding(Severity.NOTE, "effort", setup.source, text))
    return EffortModel(np.nan_to_num(values)), findings
