"""Results of an audit: verdicts, wrong coefficients, witnesses; as objects, as text and as JSON-able data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import Enum
from typing import Any

from echelon.base.claims.reading import Claim
from echelon.base.expression import Expression
from echelon.shared import one_line, public, shortened

SCHEMA_NAME = "echelon.audit/1"
ROW_WIDTH = 160
"""Characters of a row that are shown: two lines of a terminal."""


class Verdict(Enum):
    """How a claimed set compares with the exact one; the first that applies, from the bottom of this list."""

    EQUAL = "equal"
    EQUAL_TO_PRINTED_DIGITS = "equal to the printed digits"
    REDUNDANT = "redundant"
    INCOMPLETE = "incomplete"
    WRONG = "wrong"


_MEANING = {
    Verdict.EQUAL: "the claimed set is the exact one, up to the choice of representatives",
    Verdict.EQUAL_TO_PRINTED_DIGITS: "the claimed set is the exact one, to its printed digits",
    Verdict.REDUNDANT: "complete, but some rows depend on others",
    Verdict.INCOMPLETE: "every row is right, but the outputs determine more base parameters",
    Verdict.WRONG: "some rows are combinations that the outputs do not determine",
}


class Agreement(Enum):
    """Agreement of one claimed expression with what the outputs determine."""

    EXACT = "exact"
    PRINTED_DIGITS = "agrees to the printed digits"
    WRONG = "wrong"


@dataclass(frozen=True)
class TermDifference:
    """A coefficient that is wrong beside the other ones of its row."""

    parameter: str
    claimed: str  # coefficients; "0" where there is no such term
    expected: str  # coefficients; "0" where there is no such term
    difference: (
        float | None
    )  # claimed minus expected at the robot's geometry, if that is known
    # values of coefficients that are formulas at the robot's geometry, if that is known
    claimed_value: float | None = None
    expected_value: float | None = None

    def __str__(self) -> str:
        claimed = _with_value(self.claimed, self.claimed_value)
        expected = _with_value(self.expected, self.expected_value)
        if self.expected == "0":
            return f"the term {self.claimed}·{self.parameter} does not belong here: {claimed} instead of 0"
        if self.claimed == "0":
            return f"the term {self.expected}·{self.parameter} is missing: 0 instead of {expected}"
        return f"{self.parameter} has the coefficient {claimed} instead of {expected}"


def _with_value(formula: str, value: float | None) -> str:
    return formula if value is None else f"{formula} = {value:.6g}"


@dataclass(frozen=True)
class Witness:
    """A change of the standard parameters that the claimed set and the outputs disagree about."""

    change: Mapping[str, float]  # what is added to the standard parameters, SI units
    # what it changes in the claimed base parameters, by row number from 1; empty if nothing
    claimed: Mapping[int, float]
    # ``q``, ``qd``, ``qdd`` of an example, in the order of the mechanism's coordinates; ``i[name]`` for measured inputs
    state: Mapping[str, tuple[float, ...]]
    outputs: Mapping[str, float]  # change of the outputs in that state
    symbols: Mapping[str, float] = field(
        default_factory=dict
    )  # values that were assumed for symbols without one


@dataclass(frozen=True)
class ClaimFinding:
    """One claimed base parameter."""

    number: int  # its place in the claimed set, from 1
    claim: Claim
    agreement: Agreement = Agreement.EXACT
    numeric: bool = False  # whether it agrees at the robot's lengths only, because it states numbers
    redundant: bool = False  # whether it depends on the rows before it
    differences: tuple[
        TermDifference, ...
    ] = ()  # what is wrong with it; empty unless the agreement is ``WRONG``
    largest_difference: float = (
        0.0  # largest difference of a coefficient that is within the printed digits
    )
    witness: Witness | None = (
        None  # for a wrong row: a change that no output sees, but this row does
    )


@dataclass(frozen=True)
class Missing:
    """A base parameter that no claimed row sees."""

    expression: Expression
    witness: Witness  # a change that the outputs see, but no claimed row does


@public
@dataclass(frozen=True)
class Audit:
    """The comparison of a claimed set of base parameters with the exact one.

    Made by :func:`echelon.audit`.

    Attributes
    ----------
    name : str
        The mechanism's name.
    rank : int
        Number of base parameters that the outputs see.
    findings : tuple of ClaimFinding
        One per claimed row that was compared.
    missing : tuple of Missing
        Base parameters without which the claimed set does not determine the outputs.
    naming : str
        The naming in which the claims are written.
    precision : str
        To how many decimals the claims are printed, or "exact".
    ignored : tuple of Claim
        Rows that were left out on request.
    notes : tuple of str
        What may explain differences.
    skipped : tuple of Claim
        Lines of a text that hold no standard parameter but words: they were not compared.
    """

    name: str
    rank: int
    findings: tuple[ClaimFinding, ...]
    missing: tuple[Missing, ...]
    naming: str
    precision: str
    ignored: tuple[Claim, ...] = ()
    notes: tuple[str, ...] = ()
    skipped: tuple[Claim, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """The verdict over all rows."""
        agreements = {finding.agreement for finding in self.findings}
        if Agreement.WRONG in agreements:
            return Verdict.WRONG
        if self.missing:
            return Verdict.INCOMPLETE
        if any(finding.redundant for finding in self.findings):
            return Verdict.REDUNDANT
        if Agreement.PRINTED_DIGITS in agreements:
            return Verdict.EQUAL_TO_PRINTED_DIGITS
        return Verdict.EQUAL

    @property
    def numeric(self) -> bool:
        """Whether rows hold only at the robot's lengths, because they state numbers instead of symbols."""
        return any(finding.numeric for finding in self.findings)

    @property
    def equal(self) -> bool:
        """Whether the claimed set is right, exactly or to its printed digits."""
        return self.verdict in (Verdict.EQUAL, Verdict.EQUAL_TO_PRINTED_DIGITS)

    def of(self, agreement: Agreement) -> tuple[ClaimFinding, ...]:
        """Findings of one kind.

        Parameters
        ----------
        agreement : Agreement
        """
        return tuple(
            finding for finding in self.findings if finding.agreement is agreement
        )

    def to_dict(self) -> dict[str, Any]:
        """The audit as JSON-able data, schema ``echelon.audit/1``."""
        return {
            "schema": SCHEMA_NAME,
            "name": self.name,
            "verdict": self.verdict.value,
            "equal": self.equal,
            "claimed": len(self.findings),
            "rank": self.rank,
            "naming": self.naming,
            "precision": self.precision,
            "numeric": self.numeric,
            "rows": [_finding(finding) for finding in self.findings],
            "missing": [
                {"expression": str(m.expression), "witness": _witness(m.witness)}
                for m in self.missing
            ],
            "ignored": [claim.text for claim in self.ignored],
            "notes": list(self.notes),
            "skipped": [{"where": c.where, "text": c.text} for c in self.skipped],
        }

    def to_text(self) -> str:
        """The audit as plain text: verdict, wrong rows with witnesses, redundant rows, missing directions."""
        lines = [
            f"{self.name}: {self.verdict.value.upper()}: {_MEANING[self.verdict]}",
            f"{len(self.findings)} claimed, {self.rank} exact base parameters; naming: {self.naming}; "
            f"coefficients: {self.precision}",
            *_counts(self),
        ]
        for finding in self.of(Agreement.WRONG):
            lines += ["", f"wrong: {_title(finding)}"]
            lines += [f"  {text}" for text in (*finding.differences, *_proof(finding))]
        redundant = [
            f"redundant: {_title(finding)}"
            for finding in self.findings
            if finding.redundant
        ]
        if redundant:
            lines += ["", *redundant]
        for missing in self.missing:
            lines += [
                "",
                f"missing: {missing.expression}",
                *(f"  {text}" for text in _blindness(missing)),
            ]
        return "\n".join(one_line(line) for line in lines) + "\n"

    def __str__(self) -> str:
        return self.to_text()

    def __repr__(self) -> str:
        return f"Audit({self.name}: {self.verdict.value}; {len(self.findings)} claimed, {self.rank} exact)"


def _counts(audit: Audit) -> list[str]:
    texts = []
    exact, rounded = audit.of(Agreement.EXACT), audit.of(Agreement.PRINTED_DIGITS)
    if exact:
        place = " at the robot's lengths" if audit.numeric else ""
        texts.append(f"{len(exact)} exact{place}")
    if rounded:
        largest = max(finding.largest_difference for finding in rounded)
        texts.append(
            f"{len(rounded)} agree to the printed digits (largest difference {largest:.2g})"
        )
    wrong = audit.of(Agreement.WRONG)
    if wrong:
        texts.append(f"{len(wrong)} wrong")
    redundant = [finding for finding in audit.findings if finding.redundant]
    if redundant:
        texts.append(f"{len(redundant)} redundant")
    lines = [f"rows: {', '.join(texts)}"]
    if audit.missing:
        lines.append(f"missing: {len(audit.missing)}")
    if audit.ignored:
        lines.append(
            f"ignored: {len(audit.ignored)} rows ({', '.join(claim.text for claim in audit.ignored)})"
        )
    if audit.skipped:
        lines.append(f"skipped, as no row: {len(audit.skipped)} lines of text")
        lines += [
            shortened(f"  {claim.where}: {claim.text}", ROW_WIDTH)
            for claim in audit.skipped
        ]
    return lines + [f"note: {note}" for note in audit.notes]


def _title(finding: ClaimFinding) -> str:
    name = f"{finding.claim.name} = " if finding.claim.name else ""
    text = f"row {finding.number} ({finding.claim.where}): {name}{finding.claim.text}"
    return shortened(text, ROW_WIDTH)


def _proof(finding: ClaimFinding) -> list[str]:
    if finding.witness is None:
        return []
    felt = finding.witness.claimed.get(finding.number, 0.0)
    return [
        f"witness: add {_change(finding.witness)}",
        f"no output changes in any state, but this row changes by {felt:.6g}",
    ]


def _blindness(missing: Missing) -> list[str]:
    witness = missing.witness
    shown = {
        name: ", ".join(f"{value + 0.0:.4g}" for value in values)
        for name, values in witness.state.items()
    }
    state = ", ".join(f"{name} = ({text})" for name, text in shown.items())
    outputs = ", ".join(
        f"{name} by {value:.6g}" for name, value in witness.outputs.items() if value
    )
    return [
        f"witness: add {_change(witness)}",
        f"no claimed row changes, but the outputs do: {outputs}",
        f"at {state}",
    ]


def _change(witness: Witness) -> str:
    change = ", ".join(
        f"{value:+.6g} to {name}" for name, value in witness.change.items()
    )
    assumed = ", ".join(
        f"{name} = {value:g}" for name, value in witness.symbols.items()
    )
    return f"{change} (with {assumed})" if assumed else change


def _finding(finding: ClaimFinding) -> dict[str, Any]:
    claim = finding.claim
    return {
        "number": finding.number,
        "where": claim.where,
        "name": claim.name,
        "expression": claim.text,
        "columns": dict(claim.columns),
        "agreement": finding.agreement.value,
        "redundant": finding.redundant,
        "largest_difference": finding.largest_difference,
        "differences": [asdict(difference) for difference in finding.differences],
        "witness": None if finding.witness is None else _witness(finding.witness),
    }


def _witness(witness: Witness) -> dict[str, Any]:
    return asdict(witness) | {
        "claimed": {str(number): value for number, value in witness.claimed.items()}
    }
