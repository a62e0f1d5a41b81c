"""Check a saved or given set of base parameters again, with fresh randomness."""

from __future__ import annotations

import os

import numpy as np

from echelon.base.certificate import Certificate, certify
from echelon.base.model import BaseModel
from echelon.base.modes import in_mode
from echelon.base.structure import find_structure
from echelon.errors import CertificateError
from echelon.mechanism.stated import stated_values
from echelon.regressor.virtual_power import virtual_power_form
from echelon.results.saved import load_base


def verify(model: BaseModel | str | os.PathLike[str], seed: int | None = None) -> Certificate:
    """Check completeness and minimality of a set, without trusting anything it says about itself.

    The check is repeated with the recorded seed, then at new points modulo new primes.

    Parameters
    ----------
    model : BaseModel or path-like
        A model, or a JSON file written by :func:`echelon.save_base` or ``echelon derive --format json``.
    seed : int, optional
        Seed of the fresh points; derived from the recorded one if omitted.

    Returns
    -------
    Certificate
        The fresh evidence.

    Raises
    ------
    CertificateError
        If the set is not complete and minimal, or the recorded evidence does not belong to it.
    InputError
        If the file cannot be read.
    """
    if not isinstance(model, BaseModel):
        model = load_base(model)
    recorded = model.certificate
    if recorded.rank != model.rank:
        raise CertificateError(f"the certificate is for {recorded.rank} base parameters, the set has {model.rank}")
    modes: tuple[int, ...] = ()
    forms = virtual_power_form(model.mechanism)
    if forms.loops is not None:
        structure = find_structure(model.mechanism, np.random.default_rng(recorded.seed))
        forms, modes = in_mode(forms, structure.accepted), structure.modes
    values = None if model.generic else stated_values(model.mechanism)
    certify(forms, model.matrix, recorded.seed, values, modes)
    return certify(forms, model.matrix, recorded.seed + 1 if seed is None else seed, values, modes)
