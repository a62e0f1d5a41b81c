"""The ``verify`` command."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from echelon.cli.show import show
from echelon.errors import CertificateError, one_line
from echelon.results.echelon_verify import judge
from echelon.results.saved import load_base
from echelon.results.verify import verify

VALID, REFUTED = 0, 1


def run_verify(file: Path, as_json: bool, seed: int | None) -> int:
    """Check a file, also by the verifier that shares nothing with Echelon; returns the exit code."""
    try:
        model = load_base(file)
        certificate = verify(model, seed)
        code, sentence = judge(file.read_bytes())
        if code == REFUTED:
            raise CertificateError(f"the independent verifier says: {sentence}")
    except CertificateError as error:
        if as_json:
            show(json.dumps({"valid": False, "reason": str(error)}))
        else:
            show(f"{file}: NOT valid: {one_line(str(error))}")
        return REFUTED
    if as_json:
        evidence: dict[str, Any] = asdict(certificate)
        evidence["identity_primes"] = [str(p) for p in certificate.identity_primes]
        independent = {"checked": code == VALID, "says": sentence}
        found = {"valid": True, "rank": certificate.rank, "certificate": evidence, "independent": independent}
        show(json.dumps(found, indent=1, ensure_ascii=False))
    else:
        show(f"{file}: valid, {model.rank} base parameters of {len(model.parameters)}\n{certificate}")
        show(f"independent verifier: {one_line(sentence)}")
    return VALID
