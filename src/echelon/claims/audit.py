"""Audit a set of base parameters that another program, paper or person claims."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from echelon.base.derive import base_parameters
from echelon.base.expression import collect
from echelon.base.model import BaseModel
from echelon.base.reading_report import ROUNDING
from echelon.claims.compare import Geometry, Row, RowComparison, Span, compare_row, led_by, span_exactly, span_roughly
from echelon.claims.naming import AUTO, LinearReader, Naming, find_naming, names_in, plain_words, unknown_token
from echelon.claims.reading import Claim, precision_of, read_claims
from echelon.claims.result import Agreement, Audit, Finding, Missing
from echelon.claims.witness import WitnessSearch
from echelon.errors import InputError
from echelon.exact.expressions import parse
from echelon.exact.polynomial import Polynomial
from echelon.mechanism.mechanism import Mechanism

_PROPAGATED = 10.0
"""How much larger than a rounded angle its effect on a coefficient may be."""

Claims = str | os.PathLike[str] | Sequence[str] | Mapping[str, str]


def audit(
    model: BaseModel | Mechanism,
    claims: Claims,
    *,
    naming: str = AUTO,
    define: Mapping[str, str] | None = None,
    ignore: Sequence[str] = (),
) -> Audit:
    """Compare a claimed set of base parameters with the exact one.

    Parameters
    ----------
    model : BaseModel or Mechanism
        The robot; a mechanism's base parameters are derived first.
    claims : path-like, sequence of str, or mapping of str to str
        A file (CSV, JSON, or text with one expression per line), or expressions, maybe by name.
    naming : str
        ``"echelon"``, ``"symoro"``, ``"sympybotics"`` or ``"pinocchio"`` (also FIGAROH's); recognised if ``"auto"``.
    define : mapping of str to str, optional
        Symbols that the claims use and the robot's file does not have, as expressions of the file's symbols:
        ``{"RL4": "pz4"}``.
    ignore : sequence of str
        Parameters of the claims that the robot's description leaves out, such as ``"fv*"``: terms in them are dropped,
        and rows of nothing else are not compared.

    Returns
    -------
    Audit

    Raises
    ------
    InputError
        If the claims cannot be read; names the row and what would be valid.

    Examples
    --------
    >>> import echelon as ec
    >>> robot = ec.load("examples/double_pendulum.yaml")
    >>> claims = ["ZZ1 + l1^2*M2", "MX1 + l1*M2", "MY1", "ZZ2", "MX2", "MY2"]
    >>> ec.audit(robot, claims).verdict
    <Verdict.EQUAL: 'equal'>
    >>> print(ec.audit(robot, ["ZZ1 + l1*M2", *claims[1:]]).findings[0].differences[0])
    M2 has the coefficient l1 instead of l1^2
    """
    base = model if isinstance(model, BaseModel) else base_parameters(model)
    source = os.fspath(claims) if isinstance(claims, str | os.PathLike) else None
    found = read_claims(claims)
    chosen, words = find_naming([claim.text for claim in found], base, naming)
    put_in = base.special.definitions if base.special is not None and not base.generic else {}
    linking = _Linking(base, chosen, words, {**put_in, **(define or {})}, tuple(ignore), source)
    rows = [linking.row(claim) for claim in found]
    kept = [(claim, row) for claim, row in zip(found, rows, strict=True) if row is not None]
    if not kept:
        raise InputError("nothing is left to compare: every row is ignored", source=source)
    left_out = tuple(claim for claim, row in zip(found, rows, strict=True) if row is None)
    return _compare(base, [claim for claim, _ in kept], [row for _, row in kept], chosen, left_out)


def _compare(
    model: BaseModel, claims: Sequence[Claim], rows: Sequence[Row], naming: Naming, ignored: tuple[Claim, ...]
) -> Audit:
    rng = np.random.default_rng(model.seed)
    geometry, precision = Geometry.of(model), precision_of(claim.text for claim in claims)
    matrix = led_by(model.matrix, rows, rng)
    rounded = [precision_of([claim.text]).decimals is not None for claim in claims]
    compared = [compare_row(row, matrix, geometry, precision, r) for row, r in zip(rows, rounded, strict=True)]
    right = [k for k, c in enumerate(compared) if c.agreement is not Agreement.WRONG]
    search = WitnessSearch(model, matrix, tuple(rows), geometry, model.seed)
    if any(c.agreement is Agreement.PRINTED_DIGITS for c in compared):
        span = span_roughly(rows, right, matrix, geometry, precision.absolute)
    else:
        span = span_exactly(rows, right, matrix, rng)
    return Audit(
        model.mechanism.name,
        model.rank,
        tuple(_finding(k, claims[k], compared[k], span, search) for k in range(len(claims))),
        tuple(_missing(k, search) for k in span.missing),
        naming.name,
        str(precision),
        any(c.numeric for c in compared),
        ignored,
        _notes(model, compared),
    )


def _notes(model: BaseModel, compared: Sequence[RowComparison]) -> tuple[str, ...]:
    """Numeric programs take a file's 1.5708 literally; terms of that size then come from there."""
    snapped = max((snap.difference for snap in model.reading.snaps), default=0.0)
    gaps = [abs(d.difference) for c in compared for d in c.differences if d.difference is not None]
    if snapped <= ROUNDING or not any(gap <= _PROPAGATED * snapped for gap in gaps):
        return ()
    return (
        f"the robot file's rounded angles were read as exact (largest change {snapped:.2g}), which differences of this "
        "size may come from; with tolerance 0 they are taken literally, as most programs do",
    )


def _finding(index: int, claim: Claim, compared: RowComparison, span: Span, search: WitnessSearch) -> Finding:
    witness = search.unseen_by_outputs(_clearest(compared)) if compared.columns else None
    redundant = index in span.redundant
    return Finding(index + 1, claim, compared.agreement, redundant, compared.differences, compared.largest, witness)


def _clearest(compared: RowComparison) -> int:
    """The column whose coefficient is wrong by most."""
    sizes = [abs(d.difference) if d.difference is not None else 0.0 for d in compared.differences]
    return compared.columns[sizes.index(max(sizes))]


def _missing(index: int, search: WitnessSearch) -> Missing:
    matrix = search.matrix
    column = matrix.pivots[index]
    terms = [(matrix.parameters[c], value) for c, value in sorted(matrix.rows[index].items())]
    unit = search.model.mechanism.columns[column].unit
    return Missing(collect(matrix.parameters[column], unit, terms), search.unseen_by_claims(index))


@dataclass(frozen=True)
class _Linking:
    """From the names in claims to columns and symbols of a model."""

    model: BaseModel
    naming: Naming
    words: Mapping[str, str]
    definitions: Mapping[str, str]
    ignore: tuple[str, ...]
    source: str | None

    def row(self, claim: Claim) -> Row | None:
        """Coefficients by column; None if only ignored parameters occur."""
        text, odd = plain_words(claim.text, self.words)
        ignored = {name for name in names_in(text) if any(fnmatchcase(name, p) for p in self.ignore)}

        def parameter(name: str) -> str | None:
            return name if name in ignored else self.words.get(odd.get(name, name))

        try:
            terms = LinearReader(parameter, self._symbol).read(text)
        except ValueError as error:
            raise InputError(str(error), source=self.source, element=claim.where) from None
        column = {name: k for k, name in enumerate(self.model.parameters)}
        row = {column[name]: value for name, value in terms.items() if name not in ignored and value}
        if not row and not (terms and ignored):
            raise InputError(f"'{claim.text}' is zero", source=self.source, element=claim.where)
        return row or None

    def _symbol(self, name: str) -> Polynomial:
        if name in self.definitions:
            return parse(self.definitions[name], self._symbols)
        if name not in self._symbols:
            valid = [*self._symbols, *self.definitions]
            raise ValueError(unknown_token(name, self.naming, self.words, valid))
        return Polynomial.generator(name)

    @property
    def _symbols(self) -> list[str]:
        return sorted({*self.model.mechanism.symbols, *self.model.matrix.symbols})
