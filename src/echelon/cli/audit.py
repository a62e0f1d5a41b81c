"""The ``audit`` command."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from echelon.claims.audit import audit
from echelon.cli.destination import Destination, deliver
from echelon.errors import InputError
from echelon.formats.load import load

EQUAL, REFUTED = 0, 1


def run_audit(
    robot: Path,
    claimed: Path,
    reading: Mapping[str, Any],
    naming: str,
    define: Sequence[str],
    ignore: Sequence[str],
    as_json: bool,
    output: Destination | None,
) -> int:
    """Audit, then print or write; returns the exit code."""
    found = audit(load(robot, **reading), claimed, naming=naming, define=definitions(define), ignore=tuple(ignore))
    text = json.dumps(found.to_dict(), indent=1, ensure_ascii=False) + "\n" if as_json else found.to_text()
    deliver(text, output)
    return EQUAL if found.equal else REFUTED


def definitions(texts: Sequence[str]) -> dict[str, str]:
    """Symbols of the claims by name."""
    parts = [text.partition("=") for text in texts]
    for text, (name, _, value) in zip(texts, parts, strict=True):
        if not name.strip().isidentifier() or not value.strip():
            raise InputError(f"--define takes NAME=EXPRESSION, such as RL4=pz4 or L=0.45, not '{text}'")
    return {name.strip(): value.strip() for name, _, value in parts}
