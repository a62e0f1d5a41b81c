"""What an audit found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from echelon.claims.display import to_dict, to_text
from echelon.claims.findings import Agreement, Finding, Missing, Verdict
from echelon.claims.reading import Claim


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
    findings : tuple of Finding
        One per claimed row that was compared.
    missing : tuple of Missing
        Base parameters without which the claimed set does not determine the outputs.
    naming : str
        The naming in which the claims are written.
    precision : str
        To how many decimals the claims are printed, or "exact".
    numeric : bool
        Whether rows hold only at the robot's lengths, because they state numbers instead of symbols.
    ignored : tuple of Claim
        Rows that were left out on request.
    notes : tuple of str
        What may explain differences.
    """

    name: str
    rank: int
    findings: tuple[Finding, ...]
    missing: tuple[Missing, ...]
    naming: str
    precision: str
    numeric: bool
    ignored: tuple[Claim, ...] = ()
    notes: tuple[str, ...] = ()

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
        return Verdict.EQUAL_TO_PRINTED_DIGITS if Agreement.PRINTED_DIGITS in agreements else Verdict.EQUAL

    @property
    def equal(self) -> bool:
        """Whether the claimed set is right, exactly or to its printed digits."""
        return self.verdict in (Verdict.EQUAL, Verdict.EQUAL_TO_PRINTED_DIGITS)

    def of(self, agreement: Agreement) -> tuple[Finding, ...]:
        """Findings of one kind.

        Parameters
        ----------
        agreement : Agreement
        """
        return tuple(finding for finding in self.findings if finding.agreement is agreement)

    def to_dict(self) -> dict[str, Any]:
        """The audit as JSON-able data, schema ``echelon.audit/1``."""
        return to_dict(self)

    def to_text(self) -> str:
        """The audit as plain text: verdict, wrong rows with witnesses, redundant rows, missing directions."""
        return to_text(self)

    def __str__(self) -> str:
        return self.to_text()

    def __repr__(self) -> str:
        return f"Audit({self.name}: {self.verdict.value}; {len(self.findings)} claimed, {self.rank} exact)"
