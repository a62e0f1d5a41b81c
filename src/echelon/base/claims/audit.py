"""Audit a set of base parameters that another program, paper or person claims, with witnesses of what is wrong.

A witness is a change of the standard parameters that a claimed set and the outputs disagree about.  A column f that is
no pivot gives the change e_f − Σ B[p, f] e_p, which no output sees in any state; a claimed row with a wrong coefficient
at f sees it.  A change of the pivots alone that all claimed rows overlook shows what is missing.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property

import numpy as np

from echelon.algebra import Polynomial, parse
from echelon.base.claims.compare import (
    RobotNumbers,
    Row,
    compare_row,
    led_by,
    span_exactly,
    span_roughly,
)
from echelon.base.claims.notation import (
    Line,
    Notation,
    numbering_problem,
    parts_of_line,
)
from echelon.base.claims.reading import (
    AUTO,
    Claim,
    LinearReader,
    Naming,
    WrittenClaims,
    find_naming,
    precision_of,
    read_claims,
    unknown_token,
)
from echelon.base.claims.result import Agreement, Audit, ClaimFinding, Missing, Witness
from echelon.base.derive import base_of
from echelon.base.expression import collect
from echelon.base.matrix import BaseMatrix
from echelon.base.model import BaseModel
from echelon.base.reading_report import ROUNDING
from echelon.dynamics import assembly_of
from echelon.robot import Mechanism, MotionKind, Readable, all_symbols
from echelon.shared import Floats, InputError, public, shortened

PROPAGATED = 10.0
"""Largest effect on a coefficient of a change of an angle, by that change: lengths are metres, and few multiply."""

Claims = str | os.PathLike[str] | Sequence[str] | Mapping[str, str]


@public
def audit(
    model: BaseModel | Mechanism | Readable,
    claims: Claims,
    *,
    naming: str = AUTO,
    define: Mapping[str, str] | None = None,
    ignore: Sequence[str] = (),
) -> Audit:
    """Compare a claimed set of base parameters with the exact one.

    Parameters
    ----------
    model : BaseModel, Mechanism or path-like
        A saved set or its file; of a robot or its file, base parameters are derived first.
    claims : path-like, sequence of str, or mapping of str to str
        A file (CSV, JSON, or text as papers print it), or expressions, maybe by name.
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
        If claims cannot be read, or can be read in two ways; names all such rows and what would be valid.

    Examples
    --------
    >>> import echelon as ec
    >>> robot = ec.load("examples/double_pendulum.yaml")
    >>> claims = ["ZZ1 + l1^2*M2", "MX1 + l1*M2", "MY1", "ZZ2", "MX2", "MY2"]
    >>> ec.audit(robot, claims).verdict
    <Verdict.EQUAL: 'equal'>
    >>> print(ec.audit(robot, ["ZZ1 + l1*M2", *claims[1:]]).findings[0].differences[0])
    M2 has the coefficient l1 = 0.3 instead of l1^2 = 0.09
    """
    base = base_of(model)
    source = os.fspath(claims) if isinstance(claims, str | os.PathLike) else None
    put_in = (
        base.special.definitions
        if base.special is not None and not base.generic
        else {}
    )
    defined = {**put_in, **(define or {})}
    symbols = sorted({*base.mechanism.symbols, *base.matrix.symbols})
    written = read_claims(claims)
    chosen, notation, words = find_naming(
        written.texts, base, [*symbols, *defined], naming
    )
    linking = _Linking(
        base, chosen, notation, words, symbols, defined, tuple(ignore), source
    )
    read = linking.read(written)
    if not read.rows:
        ignored = "nothing is left to compare: every row is ignored"
        remarks = f"no line holds a standard parameter: {_listed(read.skipped)}"
        raise InputError(ignored if read.ignored else remarks, source=source)
    return _compare(base, read, chosen)


@dataclass(frozen=True)
class _ReadClaims:
    """Claims, taken apart."""

    claims: tuple[Claim, ...]
    rows: tuple[Row, ...]  # of the claims
    ignored: tuple[Claim, ...]  # rows of nothing but ignored parameters
    skipped: tuple[Claim, ...]  # lines that are no rows


def _listed(claims: Sequence[Claim]) -> str:
    return "; ".join(f"{claim.where}: {shortened(claim.text)}" for claim in claims)


def _compare(model: BaseModel, read: _ReadClaims, naming: Naming) -> Audit:
    claims, rows = read.claims, read.rows
    rng = np.random.default_rng(model.seed)
    geometry = RobotNumbers.of(model)
    precision = precision_of(claim.text for claim in claims)
    matrix = led_by(model.matrix, rows, rng)
    stated = [ClaimFinding(number, claim) for number, claim in enumerate(claims, 1)]
    found = [
        compare_row(f, row, matrix, geometry, precision)
        for f, row in zip(stated, rows, strict=True)
    ]
    right = [
        k for k, finding in enumerate(found) if finding.agreement is not Agreement.WRONG
    ]
    search = WitnessSearch(model, matrix, tuple(rows), geometry, model.seed)
    if any(finding.agreement is Agreement.PRINTED_DIGITS for finding in found):
        span = span_roughly(rows, right, matrix, geometry, precision.absolute)
    else:
        span = span_exactly(rows, right, matrix, rng)
    return Audit(
        model.mechanism.name,
        model.rank,
        tuple(
            replace(f, redundant=k in span.redundant, witness=search.against(f))
            for k, f in enumerate(found)
        ),
        tuple(_missing(k, search) for k in span.missing),
        naming.name,
        str(precision),
        read.ignored,
        _notes(model, found),
        read.skipped,
    )


def _notes(model: BaseModel, found: Sequence[ClaimFinding]) -> tuple[str, ...]:
    """Numeric programs take a file's 1.5708 literally; terms of that size then come from there."""
    snapped = max((snap.difference for snap in model.reading.snaps), default=0.0)
    gaps = [
        abs(d.difference)
        for f in found
        for d in f.differences
        if d.difference is not None
    ]
    if snapped <= ROUNDING or not any(gap <= PROPAGATED * snapped for gap in gaps):
        return ()
    return (
        f"Echelon took rounded angles of the robot file as exact (largest change {snapped:.2g}), which may cause "
        "differences of this size; with tolerance 0 it reads them literally, as most programs do",
    )


def _missing(index: int, search: WitnessSearch) -> Missing:
    matrix = search.matrix
    column = matrix.pivots[index]
    terms = [
        (matrix.parameters[c], value) for c, value in sorted(matrix.rows[index].items())
    ]
    unit = search.model.mechanism.columns[column].unit
    return Missing(
        collect(matrix.parameters[column], unit, terms), search.unseen_by_claims(index)
    )


@dataclass(frozen=True)
class _Linking:
    """From the names in claims to columns and symbols of a model."""

    model: BaseModel
    naming: Naming
    notation: Notation
    words: Mapping[str, str]
    symbols: Sequence[str]
    definitions: Mapping[str, str]
    ignore: tuple[str, ...]
    source: str | None

    def read(self, written: WrittenClaims) -> _ReadClaims:
        """All claims as rows; an InputError names all that cannot be read."""
        kept: list[tuple[Claim, Row]] = []
        ignored: list[Claim] = []
        skipped = [line for line in written.lines if self._is_remark(line)]
        claims = list(enumerate(written.claims))
        problems: list[tuple[int, str]] = []  # with the place of the row
        for place, line in enumerate(written.lines):
            if line in skipped:
                continue
            try:
                claims += [(place, claim) for claim in _claims_of(line)]
            except ValueError as error:
                problems.append((place, f"{line.where}: {error}"))
        for place, claim in claims:
            try:
                row = self._row(claim)
            except ValueError as error:
                problems.append((place, f"{claim.where}: {error}"))
                continue
            if row is None:
                ignored.append(claim)
            else:
                kept.append((claim, row))
        texts = [text for _, text in sorted(problems)]
        hint = ""
        if written.lines:
            texts += numbering_problem([claim.text for _, claim in claims])
            hint = "; '#' at the beginning of a line leaves it out"
        if texts:
            more = f"{len(texts)} rows cannot be read: " if texts[1:] else ""
            raise InputError(more + "; ".join(texts) + hint, source=self.source)
        return _ReadClaims(
            tuple(claim for claim, _ in kept),
            tuple(row for _, row in kept),
            tuple(ignored),
            tuple(Claim(line.text, line.where) for line in skipped),
        )

    def _is_remark(self, line: Line) -> bool:
        return not self._ignored(line.text) and self.notation.is_remark(line.text)

    def _ignored(self, text: str) -> frozenset[str]:
        """Names in a text that the user wants to leave out."""
        names = self.notation.names_in(text) if self.ignore else ()
        return frozenset(
            name for name in names if any(fnmatchcase(name, p) for p in self.ignore)
        )

    def _row(self, claim: Claim) -> Row | None:
        """Coefficients by column; None if only ignored parameters occur."""
        text, odd = self.notation.plain(claim.text)
        ignored = self._ignored(claim.text)

        def parameter(name: str) -> str | None:
            original = odd.get(name, name)
            return original if original in ignored else self.words.get(original)

        terms = LinearReader(parameter, self._symbol).read(text)
        column = {name: k for k, name in enumerate(self.model.parameters)}
        row = {
            column[name]: value
            for name, value in terms.items()
            if name not in ignored and value
        }
        if not row and not (terms and ignored):
            raise ValueError(f"'{claim.text}' is zero")
        return row or None

    def _symbol(self, name: str) -> Polynomial:
        if name in self.definitions:
            return parse(self.definitions[name], self.symbols)
        if name not in self.symbols:
            valid = [*self.symbols, *self.definitions]
            raise ValueError(unknown_token(name, self.naming, self.words, valid))
        return Polynomial.generator(name)


def _claims_of(line: Line) -> list[Claim]:
    """The claims in a line of a text."""
    return [Claim(formula, line.where, label) for label, formula in parts_of_line(line)]


STATES = 16
"""Random states, of which the one where a wrong set shows most is the witness."""
NEGLIGIBLE = 1e-12
"""Part of a change or an output that rounding makes."""


@dataclass(frozen=True)
class WitnessSearch:
    """A search for numeric examples of changes of parameters."""

    model: BaseModel
    matrix: BaseMatrix  # B with the representatives that the claims lead with
    rows: tuple[Row, ...]  # the claimed set
    geometry: RobotNumbers
    seed: int  # of the example states, and of values for symbols that have none

    def against(self, finding: ClaimFinding) -> Witness | None:
        """Witness against a wrong row: one unit of the worst parameter, compensated in all outputs."""
        if not finding.differences:
            return None
        worst = max(
            finding.differences,
            key=lambda difference: abs(difference.difference or 0.0),
        )
        column = self.matrix.parameters.index(worst.parameter)
        change = np.zeros(len(self.matrix.parameters))
        change[column] = 1.0
        change[list(self.matrix.pivots)] = -self.b[:, column]
        return self._witness(change)

    def unseen_by_claims(self, missing: int) -> Witness:
        """A unit of a pivot, with what hides it from all claimed rows."""
        pivots = list(self.matrix.pivots)
        others = [k for k in range(len(pivots)) if k != missing]
        at_pivots = self.claimed[:, pivots]
        hidden = np.linalg.lstsq(
            at_pivots[:, others], -at_pivots[:, missing], rcond=None
        )[0]
        change = np.zeros(len(self.matrix.parameters))
        change[pivots[missing]] = 1.0
        change[[pivots[k] for k in others]] = hidden
        return self._witness(change)

    @cached_property
    def assumed(self) -> dict[str, float]:
        """Values for symbols without one."""
        model = self.model.mechanism
        claimed = {s for row in self.rows for c in row.values() for s in c.symbols()}
        used = all_symbols(model) | claimed | set(self.matrix.symbols)
        rng = np.random.default_rng(self.seed)
        return {
            name: round(rng.uniform(0.2, 0.8), 2)
            for name in sorted(used)
            if name not in self.geometry.floats
        }

    @cached_property
    def b(self) -> Floats:
        """B in floats, shape (r, n)."""
        return self.matrix.floats({**self.geometry.floats, **self.assumed})

    @cached_property
    def claimed(self) -> Floats:
        """The claimed coefficients in floats, shape (claims, n)."""
        geometry = replace(
            self.geometry, floats={**self.geometry.floats, **self.assumed}
        )
        values = np.zeros((len(self.rows), len(self.matrix.parameters)))
        for i, row in enumerate(self.rows):
            for column, coefficient in row.items():
                values[i, column] = geometry.roughly(coefficient)
        return values

    @cached_property
    def states(self) -> tuple[Floats, Floats, Floats]:
        """Example states q, qd, qdd, one per row."""
        return random_states(self.model, np.random.default_rng(self.seed), self.assumed)

    @cached_property
    def regressor(self) -> Floats:
        """X at the example states, shape (states, outputs, n)."""
        return self.model.standard_regressor(
            *self.states, symbols=self.assumed, inputs=self.measured
        )

    @cached_property
    def measured(self) -> dict[str, Floats]:
        """Example values of measured inputs, such as currents, by name."""
        rng = np.random.default_rng(self.seed + 1)
        names = sorted(
            i.name[2:-1]
            for i in self.model.standard_forms.program.inputs.values()
            if i.name[:2] == "i["
        )
        return {name: rng.uniform(-2.0, 2.0, STATES).round(2) for name in names}

    def _witness(self, change: Floats) -> Witness:
        change = np.where(np.abs(change) > NEGLIGIBLE, change, 0.0)
        outputs = self.regressor @ change
        loudest = int(np.abs(outputs).sum(axis=1).argmax())
        scale = np.abs(self.regressor).max(initial=1.0)
        felt = self.claimed @ change
        q, qd, qdd = (tuple(float(v) for v in part[loudest]) for part in self.states)
        return Witness(
            {
                name: float(v)
                for name, v in zip(self.matrix.parameters, change, strict=True)
                if v
            },
            {i + 1: float(v) for i, v in enumerate(felt) if abs(v) > NEGLIGIBLE},
            {
                "q": q,
                "qd": qd,
                "qdd": qdd,
                **{f"i[{k}]": (float(v[loudest]),) for k, v in self.measured.items()},
            },
            {
                output.name: float(v) if abs(v) > NEGLIGIBLE * scale else 0.0
                for output, v in zip(
                    self.model.mechanism.outputs, outputs[loudest], strict=True
                )
            },
            self.assumed,
        )


def random_states(
    model: BaseModel,
    rng: np.random.Generator,
    symbols: Mapping[str, float] | None = None,
) -> tuple[Floats, Floats, Floats]:
    """Random states with two decimals; quaternions have unit length, and loops are closed."""
    mechanism = model.mechanism
    if closed := assembly_of(mechanism, symbols):
        return closed.random_closed_states(rng, STATES)
    q = rng.uniform(-2.0, 2.0, (STATES, len(mechanism.positions))).round(2)
    for motion in mechanism.motions:
        if motion.kind is MotionKind.BALL:
            first = mechanism.positions.index(motion.positions[0])
            q[:, first : first + 4] /= np.linalg.norm(
                q[:, first : first + 4], axis=1, keepdims=True
            )
    rates = rng.uniform(-2.0, 2.0, (2, STATES, len(mechanism.velocities))).round(2)
    return q, rates[0], rates[1]
