"""Commands that judge a file: ``verify`` and ``audit``; and ``schema``, which prints what a file has to be like."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from echelon.cli.destination import Destination, deliver
from echelon.cli.screen import json_text, show
from echelon.errors import CertificateError, InputError, one_line
from echelon.formats.robot_file import load

VALID, REFUTED = 0, 1


def run_verify(file: Path, as_json: bool, seed: int | None) -> int:
    """Check a file, also by the verifier that shares nothing with Echelon; returns the exit code."""
    from echelon.results.echelon_verify import judge
    from echelon.results.saved import load_base, verify

    try:
        model = load_base(file)
        certificate = verify(model, seed)
        code, sentence = judge(file.read_bytes())
        if code == REFUTED:
            raise CertificateError(f"the independent verifier says: {sentence}")
    except CertificateError as error:
        refusal = json_text({"valid": False, "reason": str(error)})
        show(refusal if as_json else f"{file}: NOT valid: {one_line(str(error))}")
        return REFUTED
    if as_json:
        evidence: dict[str, Any] = asdict(certificate)
        evidence["identity_primes"] = [str(p) for p in certificate.identity_primes]
        independent = {"checked": code == VALID, "says": sentence}
        show(json_text({"valid": True, "rank": certificate.rank, "certificate": evidence, "independent": independent}))
    else:
        show(f"{file}: valid, {model.rank} base parameters of {len(model.parameters)}\n{certificate}")
        show(f"independent verifier: {one_line(sentence)}")
    return VALID


def run_audit(
    robot: Path,
    claimed: Path,
    read: Mapping[str, Any],
    naming: str,
    define: Sequence[str],
    ignore: Sequence[str],
    as_json: bool,
    output: Destination | None,
) -> int:
    """Audit, then print or write; returns the exit code."""
    from echelon.claims.audit import audit

    found = audit(load(robot, **read), claimed, naming=naming, define=_definitions(define), ignore=tuple(ignore))
    deliver(json_text(found.to_dict()) if as_json else found.to_text(), output)
    return VALID if found.equal else REFUTED


def _definitions(texts: Sequence[str]) -> dict[str, str]:
    """Symbols of the claims by name, from texts ``NAME=EXPRESSION``."""
    parts = [text.partition("=") for text in texts]
    for text, (name, _, value) in zip(texts, parts, strict=True):
        if not name.strip().isidentifier() or not value.strip():
            raise InputError(f"--define takes NAME=EXPRESSION, such as RL4=pz4 or L=0.45, not '{text}'")
    return {name.strip(): value.strip() for name, _, value in parts}


def run_schema(which: str) -> None:
    """Print a JSON schema."""
    from echelon.results.schema import BaseModelRecord, IdentifiedRecord, json_schema

    if which == "description":
        from echelon.formats.schema.robot_schema import json_schema as description_schema

        found = description_schema()
    elif which == "trajectory":
        from echelon.excite.files.coefficients import trajectory_schema

        found = trajectory_schema()
    else:
        found = json_schema(IdentifiedRecord if which == "identified" else BaseModelRecord)
    show(json.dumps(found, indent=2))
