"""The ``verify`` command."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from echelon.cli.show import show
from echelon.errors import CertificateError, one_line
from echelon.results.saved import load_base
from echelon.results.verify import verify

VALID, REFUTED = 0, 1


def run_verify(file: Path, as_json: bool, seed: int | None) -> int:
    """Check a file; returns the exit code."""
    try:
        model = load_base(file)
        certificate = verify(model, seed)
    except CertificateError as error:
        if as_json:
            show(json.dumps({"valid": False, "reason": str(error)}))
        else:
            show(f"{file}: NOT valid: {one_line(str(error))}")
        return REFUTED
    if as_json:
        evidence = asdict(certificate)
        evidence["identity_primes"] = [str(p) for p in certificate.identity_primes]
        show(
            json.dumps({"valid": True, "rank": certificate.rank, "certificate": evidence}, indent=1, ensure_ascii=False)
        )
    else:
        show(f"{file}: valid, {model.rank} base parameters of {len(model.parameters)}\n{certificate}")
    return VALID
