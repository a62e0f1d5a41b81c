"""Pages about the robots of some folders.

    PYTHONPATH=src:site python -m robot_zoo DIR [--from FOLDER] [--only 'ur*'] [--jobs 4]

What is there already, of the same file and by the same program, is left as it is.  A robot without an answer is listed
with its reason and does not stop the others; the exit code is then 1.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from echelon.shared.errors import EchelonError
from robot_zoo.build import build_zoo


def main() -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog="robot_zoo", description=__doc__)
    parser.add_argument("folder", type=Path, help="directory for the pages")
    parser.add_argument(
        "--from", dest="sources", type=Path, action="append", default=[]
    )
    parser.add_argument("--only", default="*", help="a pattern of names or paths")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=300.0, help="for one robot")
    given = parser.parse_args()
    index = given.folder / "zoo.json"
    if given.folder.exists() and any(given.folder.iterdir()) and not index.exists():
        print(f"{given.folder}: there is something else already", file=sys.stderr)
        return 2
    try:
        rows = build_zoo(
            given.folder, given.sources, given.only, given.jobs, given.seconds
        )
    except EchelonError as error:
        print(error, file=sys.stderr)
        return 2
    failed = [row for row in rows if "failed" in row]
    for row in failed:
        print(f"{row['place']}: {row['failed']}")
    answered = len(rows) - len(failed)
    print(f"{answered} robots in {given.folder}, {len(failed)} without an answer")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
