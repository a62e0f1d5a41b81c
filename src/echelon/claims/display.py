"""An Audit as text and as JSON-able data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from echelon.claims.findings import Agreement, Finding, Missing, Verdict, Witness
from echelon.errors import one_line

if TYPE_CHECKING:
    from echelon.claims.result import Audit

SCHEMA_NAME = "echelon.audit/1"

_MEANING = {
    Verdict.EQUAL: "the claimed set is the exact one, up to the choice of representatives",
    Verdict.EQUAL_TO_PRINTED_DIGITS: "the claimed set is the exact one, as far as its digits tell",
    Verdict.REDUNDANT: "complete, but some rows depend on others",
    Verdict.INCOMPLETE: "what is claimed is right, but the outputs see more",
    Verdict.WRONG: "some rows see what the outputs do not",
}
_LONGEST = 160


def to_text(audit: Audit) -> str:
    """Plain text: verdict, counts, then every row that is not right, with a witness."""
    lines = [
        one_line(f"{audit.name}: {audit.verdict.value.upper()}: {_MEANING[audit.verdict]}"),
        f"{len(audit.findings)} claimed, {audit.rank} exact base parameters; naming: {audit.naming}; "
        f"coefficients: {audit.precision}",
        *_counts(audit),
    ]
    for finding in audit.of(Agreement.WRONG):
        lines += ["", f"wrong: {_title(finding)}"]
        lines += [f"  {difference}" for difference in finding.differences]
        lines += [f"  {text}" for text in _proof(finding)]
    lines += [""] * any(finding.redundant for finding in audit.findings)
    lines += [f"redundant: {_title(finding)}" for finding in audit.findings if finding.redundant]
    for missing in audit.missing:
        lines += ["", f"missing: {missing.expression}", *(f"  {text}" for text in _blindness(missing))]
    return "\n".join(one_line(line) for line in lines) + "\n"


def _counts(audit: Audit) -> list[str]:
    texts = []
    exact, rounded = audit.of(Agreement.EXACT), audit.of(Agreement.PRINTED_DIGITS)
    if exact:
        place = " at the robot's lengths" if audit.numeric else ""
        texts.append(f"{len(exact)} exact{place}")
    if rounded:
        largest = max(finding.largest_difference for finding in rounded)
        texts.append(f"{len(rounded)} agree to the printed digits (largest difference {largest:.2g})")
    wrong = audit.of(Agreement.WRONG)
    texts += [f"{len(wrong)} wrong"] * bool(wrong)
    redundant = [finding for finding in audit.findings if finding.redundant]
    texts += [f"{len(redundant)} redundant"] * bool(redundant)
    lines = [f"rows: {', '.join(texts)}", f"missing: {len(audit.missing)}"]
    if audit.ignored:
        lines.append(f"ignored: {len(audit.ignored)} rows ({', '.join(claim.text for claim in audit.ignored)})")
    lines += [f"note: {note}" for note in audit.notes]
    return lines if audit.missing else [line for line in lines if not line.startswith("missing")]


def _title(finding: Finding) -> str:
    name = f"{finding.claim.name} = " if finding.claim.name else ""
    text = one_line(f"row {finding.number} ({finding.claim.where}): {name}{finding.claim.text}")
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 2]} …"


def _proof(finding: Finding) -> list[str]:
    if finding.witness is None:
        return []
    felt = finding.witness.claimed.get(finding.number, 0.0)
    return [
        f"witness: add {_change(finding.witness)}",
        f"no output changes in any state, but this row changes by {felt:.6g}",
    ]


def _blindness(missing: Missing) -> list[str]:
    witness = missing.witness
    state = ", ".join(f"{name} = {_numbers(values)}" for name, values in witness.state.items())
    outputs = ", ".join(f"{name} by {value:.6g}" for name, value in witness.outputs.items() if value)
    return [
        f"witness: add {_change(witness)}",
        f"no claimed row changes, but the outputs do: {outputs}",
        f"at {state}",
    ]


def _change(witness: Witness) -> str:
    change = ", ".join(f"{value:+.6g} to {name}" for name, value in witness.change.items())
    assumed = ", ".join(f"{name} = {value:g}" for name, value in witness.symbols.items())
    return f"{change} (with {assumed})" if assumed else change


def _numbers(values: Sequence[float]) -> str:
    return "(" + ", ".join(f"{value + 0.0:.4g}" for value in values) + ")"


def to_dict(audit: Audit) -> dict[str, Any]:
    """JSON-able data of schema ``echelon.audit/1``."""
    return {
        "schema": SCHEMA_NAME,
        "name": audit.name,
        "verdict": audit.verdict.value,
        "equal": audit.equal,
        "claimed": len(audit.findings),
        "rank": audit.rank,
        "naming": audit.naming,
        "precision": audit.precision,
        "numeric": audit.numeric,
        "rows": [_finding(finding) for finding in audit.findings],
        "missing": [{"expression": str(m.expression), "witness": _witness(m.witness)} for m in audit.missing],
        "ignored": [claim.text for claim in audit.ignored],
        "notes": list(audit.notes),
    }


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "number": finding.number,
        "where": finding.claim.where,
        "name": finding.claim.name,
        "expression": finding.claim.text,
        "columns": dict(finding.claim.columns),
        "agreement": finding.agreement.value,
        "redundant": finding.redundant,
        "largest_difference": finding.largest_difference,
        "differences": [
            {"parameter": d.parameter, "claimed": d.claimed, "expected": d.expected, "difference": d.difference}
            for d in finding.differences
        ],
        "witness": None if finding.witness is None else _witness(finding.witness),
    }


def _witness(witness: Witness) -> dict[str, Any]:
    claimed: Mapping[str, float] = {str(number): value for number, value in witness.claimed.items()}
    return {
        "change": dict(witness.change),
        "claimed": claimed,
        "state": {name: list(values) for name, values in witness.state.items()},
        "outputs": dict(witness.outputs),
        "symbols": dict(witness.symbols),
    }
