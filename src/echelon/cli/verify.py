"""The command that checks a saved set again."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from echelon.base import Certificate, judge, load_set, verify
from echelon.cli.process import Exit
from echelon.cli.screen import json_text, show, steps
from echelon.shared import CertificateError, one_line


def run_verify(file: Path, seed: int | None, *, as_json: bool) -> int:
    """Check a set with both verifiers and show what each found; returns the exit code."""
    title = f"verifying {file.name}"
    try:
        with steps(f"{title}: reading") as step:
            model = load_set(file)
            certificate = verify(model, seed, lambda phase: step(f"{title}: {phase}"))
            step(f"{title}: independent verifier")
            code, sentence = judge(file.read_bytes())
        if code == Exit.REFUTED:
            raise CertificateError(f"independent verifier: {sentence}")
    except CertificateError as error:
        refusal = json_text({"valid": False, "reason": str(error)})
        show(refusal if as_json else f"{file}: NOT valid: {one_line(str(error))}")
        return Exit.REFUTED
    whole = (
        not certificate.unchecked or code == Exit.VALID
    )  # the independent verifier takes minors at the stated values
    if as_json:
        show(_as_json(certificate, code, sentence, whole=whole))
    else:
        count = f"{certificate.rank} base parameters of {len(model.parameters)}"
        show(_as_text(f"{file}", count, certificate, sentence, whole=whole))
    return Exit.VALID if whole else Exit.NOT_COVERED


def _as_json(certificate: Certificate, code: int, sentence: str, *, whole: bool) -> str:
    evidence: dict[str, Any] = asdict(certificate)
    evidence["identity_primes"] = [str(p) for p in certificate.identity_primes]
    return json_text(
        {
            "valid": whole,
            "rank": certificate.rank,
            "holds": certificate.holds,
            "certificate": evidence,
            "independent": {"checked": code == Exit.VALID, "says": sentence},
        }
    )


def _as_text(
    file: str, count: str, certificate: Certificate, sentence: str, *, whole: bool
) -> str:
    unchecked = "; ".join(certificate.unchecked)
    verdict = f"valid, {count}, {certificate.holds}"
    if not whole:
        verdict = f"NOT valid as a whole, {count}: not checked: {unchecked}; checked {certificate.holds}:"
    not_checked = sentence.startswith("NOT checked")
    alone = "; the lines above still hold" if not_checked else ""
    return "\n".join(
        [
            f"{file}: {one_line(verdict)}",
            one_line(str(certificate)),
            f"independent verifier: {one_line(sentence)}{alone}",
        ]
    )
