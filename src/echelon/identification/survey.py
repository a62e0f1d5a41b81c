"""Survey: a first look at the logs, from which everything is chosen that the set-up leaves open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.identification.delays import with_delays
from echelon.identification.settings import Setup
from echelon.logs.columns.column_map import ColumnMap
from echelon.logs.finding import Finding, Severity
from echelon.logs.preparation.choices import chosen
from echelon.logs.preparation.settings import Preparation
from echelon.logs.read_log import LogPiece, read_log
from echelon.logs.recording import Segment

_LOGS = 64
"""Logs that are looked at; of a long log, its first piece."""
_SAMPLES = 1 << 18
"""Samples that choices are made from; faults are looked for in the first piece of every log."""


@dataclass(frozen=True)
class Survey:
    """What a first look at the logs decides.

    Attributes
    ----------
    preparation : Preparation
        With every choice made.
    columns : tuple of ColumnMap
        What the columns of each kind of log were taken for.
    findings : tuple of Finding
    """

    preparation: Preparation
    columns: tuple[ColumnMap, ...]
    findings: tuple[Finding, ...]


def survey(setup: Setup, base: BaseModel, paths: Sequence[Path], unseen: Sequence[Path] = ()) -> Survey:
    """Look at the logs and choose what the set-up leaves open.

    Parameters
    ----------
    setup : Setup
    base : BaseModel
    paths : sequence of Path
        Logs that the model is fitted to.  The held-out end of such a log has a say in filters and delays, not in
        parameters.
    unseen : sequence of Path
        Logs that are held out: their faults are named, they have no say in anything.

    Raises
    ------
    InputError
        If a log cannot be read or nothing of it can be used.
    """
    segments: list[Segment] = []
    columns: list[ColumnMap] = []
    findings: list[Finding] = []
    for path in paths[:_LOGS]:
        piece = _first_piece(setup, path)
        findings += piece.findings
        if piece.columns not in columns:
            columns.append(piece.columns)
        if sum(map(len, segments)) < _SAMPLES:
            segments += piece.segments
    for path in unseen[:_LOGS]:
        findings += _first_piece(setup, path).findings
    if max(len(paths), len(unseen)) > _LOGS:
        text = f"of {len(paths)} logs that are fitted and {len(unseen)} others the first {_LOGS} each were looked at"
        findings.append(Finding(Severity.NOTE, "survey", "", text))
    preparation = replace(chosen(setup.preparation, segments, setup.mechanism), delays=setup.preparation.delays)
    preparation = with_delays(preparation, segments, base)
    return Survey(preparation, tuple(columns), tuple(findings))


def _first_piece(setup: Setup, path: Path) -> LogPiece:
    piece = next(read_log(path, setup.mechanism, setup.columns, rate=setup.preparation.rate), None)
    if piece is None:
        raise InputError("the log is empty", source=str(path))
    return piece
