"""The ``setup`` command."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from echelon.cli.destination import Destination
from echelon.cli.screen import show, steps


def run_setup(robot: Path, logs: Sequence[Path], output: Destination | None) -> None:
    """Write a set-up for a robot and its logs, and say what it leaves open."""
    from echelon.setup.skeleton import skeleton

    with steps(f"looking at {logs[0]}"):
        found = skeleton(robot, logs, Path() if output is None else output.path.parent)
    if output is None:
        show(found.text.rstrip())
        return
    output.write(found.text)
    for line in found.report:
        show(line)
    for question in found.undecided:
        show(f"not decided: {question}")
    show(f"wrote {output.path}; next:  echelon identify {output.path} {' '.join(map(str, logs))} -o result/")
