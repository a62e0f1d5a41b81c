"""``derive --compare-numeric``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from echelon.base.numeric_rank import NumericComparison, compare_numeric
from echelon.cli.destination import Destination, deliver
from echelon.cli.progress import progress
from echelon.errors import one_line
from echelon.formats.load import load
from echelon.mechanism.mechanism import Mechanism
from echelon.seeds import DEFAULT_SEED


def run_compare_numeric(
    robot: Path, reading: Mapping[str, Any], output: Destination | None, seed: int | None, *, as_json: bool
) -> None:
    """Count exactly and numerically, then print or write."""
    with progress(f"comparing ranks of {robot.name}"):
        mechanism = load(robot, **reading)
        found = compare_numeric(mechanism, seed=DEFAULT_SEED if seed is None else seed)
    text = json.dumps(_record(mechanism, found), indent=1, ensure_ascii=False) if as_json else _text(mechanism, found)
    deliver(text + "\n", output)


def _text(mechanism: Mechanism, found: NumericComparison) -> str:
    numeric, rank = found.numeric, found.rank
    literal = f" ({found.literal_rank} for the literal numbers of the file)" if found.literal_rank != rank else ""
    rows = [
        ("tolerance", [f"{t:.0e}" for t in numeric.tolerances]),
        ("singular values", [str(r) for r in numeric.ranks]),
        ("QR, pivoted", [str(r) for r in numeric.ranks_by_qr]),
    ]
    lines = [f"{one_line(mechanism.name)}: {rank} base parameters of {numeric.columns} standard parameters{literal}"]
    lines += [f"  {title:<16}" + "".join(f"{cell:>8}" for cell in cells) for title, cells in rows]
    widest = numeric.widest_gap(besides=rank)
    elsewhere = f"; widest elsewhere: {widest[1]:.1e} at {widest[0]}" if widest is not None else ""
    lines.append(f"gap in the singular values at {rank}: {numeric.gap(rank):.1e}{elsewhere}")
    return "\n".join([*lines, found.verdict])


def _record(mechanism: Mechanism, found: NumericComparison) -> dict[str, Any]:
    numeric, rank = found.numeric, found.rank
    widest, gap = numeric.widest_gap(besides=rank), numeric.gap(rank)
    return {
        "schema": "echelon.numeric/1",
        "name": mechanism.name,
        "rank": rank,
        "literal_rank": found.literal_rank,
        "rows": numeric.rows,
        "tolerances": list(numeric.tolerances),
        "svd": list(numeric.ranks),
        "qr": list(numeric.ranks_by_qr),
        "gap": gap if gap < float("inf") else None,
        "widest_gap_elsewhere": None if widest is None else {"rank": widest[0], "gap": widest[1]},
        "verdict": found.verdict,
        "singular_values": list(numeric.singular),
    }
