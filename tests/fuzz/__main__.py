"""Run many cases, several at the same time, and list those that went wrong."""

from __future__ import annotations

import argparse
import gc
import os
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from fuzz.cases import Fault, cases, prepared, run_case


def _share(
    numbers: range, seed: int, folder: Path, only: str, keep: Path | None
) -> list[Fault]:
    """The cases of one worker."""
    material = prepared(folder)
    gc.collect()
    gc.freeze()  # so that children do not copy what they only look through
    faults = []
    for kind, number in cases(numbers, only):
        fault = run_case(material, kind, number, seed, keep)
        if fault is not None:
            print(fault, flush=True)
            faults.append(fault)
    return faults


def main() -> int:
    """Run the cases that were asked for; 0 if none went wrong."""
    parser = argparse.ArgumentParser(prog="make fuzz", description=__doc__)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument(
        "--first", type=int, default=0, metavar="N", help="number of the first case"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--only", default="", metavar="TEXT", help="formats whose names contain this"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument(
        "--keep",
        type=Path,
        metavar="FOLDER",
        help="where files that went wrong are kept",
    )
    chosen = parser.parse_args()
    start, workers = time.monotonic(), []
    with tempfile.TemporaryDirectory() as folder:
        os.environ.setdefault("ECHELON_CACHE", folder)
        for job in range(chosen.jobs):
            numbers = range(
                chosen.first + job, chosen.first + chosen.cases, chosen.jobs
            )
            child = os.fork()
            if not child:
                place = Path(folder, str(job))
                place.mkdir()
                faults = _share(numbers, chosen.seed, place, chosen.only, chosen.keep)
                os._exit(min(len(faults), 100))
            workers.append(child)
        codes = [
            os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in workers
        ]
    print(
        f"{chosen.cases} cases in {time.monotonic() - start:.0f} s, {sum(codes)} went wrong"
    )
    return int(any(codes))


if __name__ == "__main__":
    sys.exit(main())
