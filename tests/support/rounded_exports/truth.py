"""Ranks of the exact mechanisms, by an oracle that uses nothing of the package.

`exact_ranks.json` beside this file keeps them; `python -m support.rounded_exports.truth [NAME ...]` computes those that
are named, or missing, and writes them there.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from flint import ctx

from support.loop_oracle import Rank, rank
from support.rounded_exports.geometry import BITS
from support.rounded_exports.mechanism import Exact
from support.rounded_exports.table import NAMES, build

KEPT = Path(__file__).with_name("exact_ranks.json")


def computed(exact: Exact, seed: int = 1) -> Rank:
    with ctx.workprec(BITS):
        return rank(exact.linkage(), seed)


def kept() -> dict[str, dict[str, float]]:
    return json.loads(KEPT.read_text()) if KEPT.exists() else {}


def main(names: list[str]) -> None:
    for name in names or [name for name in NAMES if name not in kept()]:
        start = time.process_time()
        try:
            found = computed(build(name))
        except ArithmeticError as error:
            print(f"{name}: {error}", flush=True)  # noqa: T201
            continue
        print(f"{name}: {found} in {time.process_time() - start:.1f} s", flush=True)  # noqa: T201
        table = kept() | {
            name: {
                "freedom": found.freedom,
                "rank": found.rank,
                "gap": float(f"{found.gap:.1e}"),
            }
        }
        entries = [
            f"  {json.dumps(key)}: {json.dumps(table[key])}"
            for key in NAMES
            if key in table
        ]
        KEPT.write_text("{\n" + ",\n".join(entries) + "\n}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
