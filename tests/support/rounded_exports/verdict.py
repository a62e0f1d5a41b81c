"""What the package says of exports, beside the truth."""

from __future__ import annotations

import re
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import echelon as ec
from support.rounded_exports.export import Export
from support.rounded_exports.files import write
from support.rounded_exports.truth import kept

RIGHT, DOUBTED, REFUSED = "right", "right, with a doubt", "refused"
NAMED, UNNAMED, SILENT = (
    "wrong, doubt names it",
    "wrong, with a doubt",
    "WRONG IN SILENCE",
)
KINDS = (RIGHT, DOUBTED, REFUSED, NAMED, UNNAMED, SILENT)


@dataclass(frozen=True)
class Verdict:
    """An answer to one export: its kind, what was said, and the seconds of the processor that it took."""

    export: Export
    kind: str
    said: str
    seconds: float

    def __str__(self) -> str:
        return f"{self.export.code}: {self.kind}: {self.said} ({self.seconds:.1f} s)"


def judged(export: Export, folder: Path, sets: bool = False) -> Verdict:
    """The rank of an export by `base_structure`, or the set of `base_parameters`, judged."""
    truth = kept()[export.mechanism]["rank"]
    file, start = write(export, folder), time.process_time()
    try:
        rank, doubt = (answered_set if sets else answered_rank)(
            file, export.to_be_freed
        )
    except ec.EchelonError as refusal:
        return Verdict(
            export, REFUSED, f"for {truth}: {refusal}", time.process_time() - start
        )
    if rank == truth:
        kind = DOUBTED if doubt else RIGHT
    elif not doubt:
        kind = SILENT
    else:
        kind = NAMED if names(doubt, truth) else UNNAMED
    return Verdict(
        export,
        kind,
        f"{rank} for {truth} {doubt}".rstrip(),
        time.process_time() - start,
    )


def answered_rank(file: Path, floating: bool) -> tuple[int, str]:
    """The rank, and what speaks against it; the question whether lengths are millimetres is no doubt."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        rank = ec.base_structure(ec.load(file, floating=floating)).rank
    doubts = (str(w.message) for w in caught if issubclass(w.category, ec.DoubtWarning))
    return rank, " ".join(doubt for doubt in doubts if "millimetres?" not in doubt)


def answered_set(file: Path, floating: bool) -> tuple[int, str]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        base = ec.base_parameters(ec.load(file, floating=floating))
    return base.rank, base.reading.doubt


def names(doubt: str, count: float) -> bool:
    """Whether a text has a count among its whole numbers, or within a range that it states, as in 6 to 30."""
    ranges = re.findall(r"(?<![\d.])(\d+) to (\d+)(?![\d]|\.\d)", doubt)
    if any(int(low) <= count <= int(high) for low, high in ranges):
        return True
    return re.search(rf"(?<![\d.]){count:.0f}(?![\d]|\.\d)", doubt) is not None


def table(
    verdicts: Iterable[Verdict], title: str, key: Callable[[Export], object]
) -> str:
    """Verdicts of each kind, by a property of exports."""
    found = list(verdicts)
    values = sorted(
        {key(v.export) for v in found},
        key=lambda value: (isinstance(value, str), value),
    )
    kinds = [*KINDS, *sorted({v.kind for v in found} - {*KINDS})]
    lines = [f"{title:<12}" + "".join(f"{kind:>24}" for kind in kinds)]
    for value in [*values, None]:
        counts = Counter(
            v.kind for v in found if value is None or key(v.export) == value
        )
        lines.append(
            f"{'all' if value is None else str(value):<12}"
            + "".join(f"{counts[kind]:>24}" for kind in kinds)
        )
    return "\n".join(lines)


def tables(verdicts: list[Verdict]) -> str:
    keys: dict[str, Callable[[Export], object]] = {
        "digits": lambda e: e.digits,
        "format": lambda e: e.format,
        "frames": lambda e: e.frames,
        "unit": lambda e: e.unit,
    }
    return "\n\n".join(table(verdicts, title, key) for title, key in keys.items())
