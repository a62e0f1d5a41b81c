"""Plant every fault in a copy of the checkout, one after another, and see whether tests notice.

First the tests that are named with a fault run; only if they pass, the wider set.  The exit status is 0 if nearly all
faults are caught and all still apply to the source.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

from mutation.fault import ROOT, Fault
from mutation.faults import FAULTS

CAUGHT = 0.95
"""Share of the faults that tests must catch."""

COPIED = (
    "src",
    "tests",
    "examples",
    "schemas",
    "docs",
    "conftest.py",
    "pyproject.toml",
    "CHANGELOG.md",
    "README.md",
)
WIDER = " ".join(
    (
        "base/test_structure.py",
        "base/test_base_model.py",
        "base/test_closed_form.py",
        "base/test_certificate.py",
        "mechanism/test_joints.py",
        "formats/test_description.py",
        "formats/test_urdf.py",
        "mechanism/test_effects.py",
        "base/test_sensors.py",
        "regressor/test_loops_truths.py",
        "base/test_linear_model.py",
        "dynamics/test_evaluation.py",
    )
)
SECONDS = 300
"""Longer than any of these runs takes; what takes longer has noticed, too."""


def copied(folder: Path) -> Path:
    """A copy of the checkout without what was compiled."""
    folder.mkdir()
    ignored = shutil.ignore_patterns("__pycache__", ".*_cache", ".hypothesis")
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=ignored)
        elif source.exists():
            shutil.copy(source, folder / name)
    return folder


def passes(copy: Path, tests: str) -> bool:
    """Whether some tests pass in a copy with a fault; bytecode of the fault is not kept."""
    try:
        return not _tested(copy, tests, {"PYTHONDONTWRITEBYTECODE": "1"}, SECONDS)
    except subprocess.TimeoutExpired:
        return False


def _tested(
    copy: Path, arguments: str, variables: Mapping[str, str], limit: float | None
) -> str:
    """Run tests; what was printed if one failed."""
    environment = {**os.environ, **variables, "PYTHONPATH": str(copy / "src")}
    options = ["-x", "-q", "--no-header", "-p", "no:cacheprovider", "-m", "not slow"]
    options += ["--hypothesis-profile", "unshrunk"]
    chosen = [
        f"tests/{word}" if ".py" in word else word
        for word in dict.fromkeys(arguments.split())
    ]
    command = [sys.executable, "-m", "pytest", *options, *chosen]
    run = subprocess.run(
        command,
        cwd=copy,
        env=environment,
        capture_output=True,
        text=True,
        timeout=limit,
        check=False,
    )
    if run.returncode not in (
        0,
        1,
        2,
    ):  # 1: a test failed; 2: a file could not even be imported
        sys.exit(f"pytest could not run {arguments}:\n{run.stdout}{run.stderr}")
    return run.stdout if run.returncode else ""


def noticed(copy: Path, fault: Fault) -> str:
    """What became of a fault: ``"caught"``, ``"caught by the wider set"``, ``"SURVIVED"`` or why it does not apply."""
    file = copy / fault.path
    text = file.read_text(encoding="utf-8")
    try:
        file.write_text(fault.applied(text), encoding="utf-8")
    except ValueError as error:
        return f"DOES NOT APPLY: {error}"
    try:
        if not passes(copy, fault.tests):
            return "caught"
        return "SURVIVED" if passes(copy, WIDER) else "caught by the wider set"
    finally:
        file.write_text(text, encoding="utf-8")


def run(faults: Sequence[Fault], jobs: int) -> list[str]:
    """What became of each fault."""
    copies: SimpleQueue[Path] = SimpleQueue()

    def one(fault: Fault) -> str:
        copy, start = copies.get(), time.monotonic()
        outcome = noticed(copy, fault)
        copies.put(copy)
        print(
            f"{outcome:24} {time.monotonic() - start:5.1f} s  {fault.file}: {fault.breaks}",
            flush=True,
        )
        return outcome

    with tempfile.TemporaryDirectory() as folder:
        first = copied(Path(folder, "0"))
        print("the tests that are to fall, without a fault ...", flush=True)
        failed = _tested(
            first, f"-n {jobs} " + " ".join(fault.tests for fault in faults), {}, None
        )
        if failed:
            sys.exit(f"they do not pass as it is; mend that first\n{failed}")
        copies.put(first)
        for number in range(1, jobs):
            copies.put(Path(shutil.copytree(first, Path(folder, str(number)))))
        with ThreadPoolExecutor(jobs) as pool:
            return list(pool.map(one, faults))


def main() -> int:
    """Run the faults that were asked for."""
    parser = argparse.ArgumentParser(prog="make mutate", description=__doc__)
    parser.add_argument(
        "--only",
        default="",
        metavar="TEXT",
        help="faults whose file or description contains this",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        default=os.cpu_count() or 1,
        help="how many run at the same time",
    )
    chosen = parser.parse_args()
    faults = [
        fault for fault in FAULTS if chosen.only in f"{fault.file}: {fault.breaks}"
    ]
    if not faults:
        parser.error(f"no fault is called '{chosen.only}'")
    outcomes = run(faults, max(1, chosen.jobs))
    caught = sum(outcome.startswith("caught") for outcome in outcomes)
    print(f"\n{caught} of {len(faults)} faults were caught")
    for fault, outcome in zip(faults, outcomes, strict=True):
        if not outcome.startswith("caught"):
            print(
                f"{outcome}: {fault.file}: {fault.breaks}: {fault.old!r} -> {fault.new!r} ({fault.tests})"
            )
    applied = not any(outcome.startswith("DOES NOT APPLY") for outcome in outcomes)
    return 0 if applied and caught >= CAUGHT * len(faults) else 1


if __name__ == "__main__":
    sys.exit(main())
