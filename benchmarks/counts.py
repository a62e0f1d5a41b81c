"""How many base parameters FIGAROH counts in public robots, beside the exact number.

    python benchmarks/counts.py          measure, and write benchmarks/results/counts.md

FIGAROH stacks the regressor of Pinocchio at random states and counts diagonal entries of a pivoted QR above its own
tolerance.  Both sides read the same URDF with the same joints; joints that mimic others are independent for both.
"""

from __future__ import annotations

from datetime import date
from pathlib import Path

import numpy as np
import pinocchio as pin

import echelon as ec
from anchors.figaroh_tool import VERSION, base_columns, regressor_builder
from report import table
from robots import find_urdf

ROBOTS = (
    "ur10_robot", "panda", "xarm7", "kinova", "so100", "z1", "a1", "hyq_no_sensors", "baxter", "tiago",
    "talos_reduced", "pr2",
)  # fmt: skip
SAMPLES, SEEDS = 200, 2
RESULTS = Path(__file__).with_name("results") / "counts.md"


def counted(urdf: Path, seed: int) -> int:
    """FIGAROH's count at random states."""
    model, rng = pin.buildModelFromUrdf(str(urdf)), np.random.default_rng(seed)
    q = np.array(
        [
            pin.integrate(model, pin.neutral(model), v)
            for v in rng.uniform(-3, 3, (SAMPLES, model.nv))
        ]
    )
    qd, qdd = (
        rng.uniform(-3, 3, (SAMPLES, model.nv)),
        rng.uniform(-10, 10, (SAMPLES, model.nv)),
    )
    return base_columns(regressor_builder(model)(q, qd, qdd))


def row(name: str) -> list[str]:
    """A robot with both counts."""
    urdf = find_urdf(f"{name}.urdf")
    base = ec.base_parameters(ec.load(urdf, independent_mimics=True))
    found = sorted({counted(urdf, seed) for seed in range(SEEDS)})
    literal = (
        base.rank if base.reading.literal_rank is None else base.reading.literal_rank
    )
    return [name, str(base.rank), str(literal), ", ".join(map(str, found))]


def main() -> None:
    rows = []
    for name in ROBOTS:
        rows.append(row(name))
        print(*rows[-1], sep=" | ", flush=True)
    head = ["robot", "exact", "exact, numbers taken literally", f"FIGAROH {VERSION}"]
    versions = f"{date.today()}; pin {pin.__version__}, echelon {ec.__version__}"
    how = f"{SAMPLES} random states, {SEEDS} seeds (several numbers where they differ), FIGAROH's own tolerance"
    RESULTS.write_text(
        f"# Counts of another tool\n\n{versions}; {how}.\n\n{table(head, rows)}\n",
        encoding="utf-8",
    )


if __name__ == "__main__":
    main()
