"""Exports as files for closer looks, and what the package says of them.

`python -m support.rounded_exports --out DIR --count N` writes N exports and `truth.txt`; `--only CODE_OR_NAME` takes
those of a mechanism or one export by its code (`scissor_two__m4w`); `--judge` loads them, too, and prints tables.
"""

from __future__ import annotations

import argparse
import signal
import tempfile
from dataclasses import replace
from pathlib import Path

from support.rounded_exports.export import (
    FORMATS,
    FRAMES,
    Export,
    named,
    plain_exports,
    some_exports,
)
from support.rounded_exports.files import write
from support.rounded_exports.table import NAMES
from support.rounded_exports.truth import kept
from support.rounded_exports.verdict import Verdict, judged, tables


class OutOfTimeError(Exception):
    pass


def within(seconds: int, export: Export, folder: Path, sets: bool) -> Verdict:
    def ended(*_: object) -> None:
        raise OutOfTimeError

    signal.signal(signal.SIGALRM, ended)
    signal.alarm(seconds)
    try:
        return judged(export, folder, sets)
    except OutOfTimeError:
        return Verdict(export, "out of time", "", seconds)
    except Exception as crash:  # told, and counted as an answer of its own
        return Verdict(export, "CRASH", repr(crash), 0)
    finally:
        signal.alarm(0)


def main() -> None:
    read = argparse.ArgumentParser(
        prog="python -m support.rounded_exports", description=__doc__
    )
    read.add_argument(
        "--out",
        type=Path,
        help="folder of the files; a temporary one if it is left out",
    )
    read.add_argument("--count", type=int, default=60)
    read.add_argument("--seed", type=int, default=0)
    read.add_argument(
        "--only", action="append", default=[], help="mechanism, or code of one export"
    )
    read.add_argument("--format", choices=list(FORMATS))
    read.add_argument("--digits", type=int)
    read.add_argument("--frames", choices=list(FRAMES))
    read.add_argument(
        "--plain",
        action="store_true",
        help="special mechanisms in frames along the world, 3 and 4 digits",
    )
    read.add_argument("--judge", action="store_true")
    read.add_argument("--sets", action="store_true", help="judge sets instead of ranks")
    read.add_argument(
        "--seconds", type=int, default=300, help="of the clock, for one export"
    )
    options = read.parse_args()
    known = kept()
    codes = [code for code in options.only if "__" in code]
    names = tuple(
        n for n in NAMES if n in known and (not options.only or n in options.only)
    )
    exports = [named(code) for code in codes] + (
        some_exports(options.count, options.seed, names) if names else []
    )
    exports = plain_exports() if options.plain else exports
    fixed = {
        key: getattr(options, key)
        for key in ("format", "digits", "frames")
        if getattr(options, key)
    }
    exports = list(dict.fromkeys(replace(export, **fixed) for export in exports))
    folder = options.out or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    truths, verdicts = [], []
    for export in exports:
        file = write(export, folder)
        truth = known[export.mechanism]
        floating = ", to be read with floating=True" * export.to_be_freed
        truths.append(
            f"{file.name}: rank {truth['rank']}, freedom {truth['freedom']}{floating}"
        )
        if options.judge:
            verdicts.append(within(options.seconds, export, folder, options.sets))
            print(verdicts[-1], flush=True)  # noqa: T201
    (folder / "truth.txt").write_text("\n".join([*truths, ""]))
    print(tables(verdicts) if verdicts else f"{len(truths)} exports in {folder}")  # noqa: T201


if __name__ == "__main__":
    main()
