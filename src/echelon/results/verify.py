"""Check a saved or given set of base parameters again, with fresh randomness."""

from __future__ import annotations

import os
import secrets
from dataclasses import fields
from math import isclose

import numpy as np

from echelon.base.certificate import Certificate, certify
from echelon.base.model import BaseModel
from echelon.base.structure import find_structure
from echelon.errors import CertificateError
from echelon.mechanism.stated import stated_values
from echelon.regressor.virtual_power import virtual_power_form
from echelon.results.saved import load_base

_SEED_BITS = 128
_SAME = 1e-6  # logarithms; sums of them may round differently elsewhere


def verify(model: BaseModel | str | os.PathLike[str], seed: int | None = None) -> Certificate:
    """Check completeness and minimality of a set, without trusting anything it says about itself.

    The recorded evidence must be what its seed gives.  Then the check is repeated at points modulo primes that whoever
    made the file cannot know: they come from the operating system's entropy.

    Parameters
    ----------
    model : BaseModel or path-like
        A model, or a JSON file written by :func:`echelon.save_base` or ``echelon derive --format json``.
    seed : int, optional
        Seed of the fresh points, to repeat a verification: that of its certificate.

    Returns
    -------
    Certificate
        The fresh evidence, with its seed.

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
    if recorded.seed != model.seed:
        raise CertificateError(f"the certificate has the seed {recorded.seed}, the set {model.seed}")
    modes: tuple[int, ...] = ()
    forms = virtual_power_form(model.mechanism)
    if forms.loops is not None:
        structure = find_structure(model.mechanism, np.random.default_rng(recorded.seed))
        forms, modes = structure.on_curves(forms), structure.modes
    values = None if model.generic else stated_values(model.mechanism)
    _compare(recorded, certify(forms, model.matrix, recorded.seed, values, modes))
    return certify(forms, model.matrix, secrets.randbits(_SEED_BITS) if seed is None else seed, values, modes)


def _compare(recorded: Certificate, repeated: Certificate) -> None:
    """Refuse evidence that is not what its own seed gives."""
    for field in fields(Certificate):
        stated, found = getattr(recorded, field.name), getattr(repeated, field.name)
        same = (
            isclose(stated, found, abs_tol=_SAME)
            if isinstance(stated, float) and found is not None
            else stated == found
        )
        if not same:
            raise CertificateError(f"the recorded {field.name} {stated} is not what its seed gives: {found}")
