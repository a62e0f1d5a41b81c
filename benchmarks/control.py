"""Functions of controllers in generated C, one call at a time: beside inverse dynamics, and beside Pinocchio's ABA.

``python benchmarks/control.py [rounds]`` prints medians of ratios of the same round; a factor of inverse dynamics above
1.5 for Slotine and Li's forces of a UR10, or accelerations that take longer than Pinocchio's, end it with status 1.
"""

from __future__ import annotations

import sys

import numpy as np

from anchors.generated_c import compiled
from echelon.codegen import generate
from machine.cases import Case, urdf_case
from ratios import interleaved_rounds
from tabular import table
from targets import Target

FUNCTIONS = ("inverse_dynamics", "slotine_li", "forward_dynamics")
SLOWER = 1.5  # inverse dynamics that Slotine and Li's forces of a UR10 may take

_STATES = 500
_CALLS = 100_000


def row(case: Case, repeats: int) -> tuple[list[str], list[Target]]:
    """Nanoseconds of each function and of Pinocchio's, and what must hold."""
    base, states = case.base, case.states(_STATES)
    stated = [value or 0.0 for value in base.mechanism.standard_values()]
    given = dict(zip(("q", "qd", "qdd"), states, strict=True))
    given["qdr"], given["qddr"], _ = case.states(_STATES, seed=2)
    given["parameters"] = base.B_float() @ np.array(stated)
    turns, shape = _CALLS // _STATES, (_STATES, case.outputs)
    found, timers = {}, {}
    for name in FUNCTIONS:
        function = compiled(generate(base, "c", [name], name=case.name), name)
        result = found[name] = np.zeros(shape)
        function.calls(given, result)
        given.setdefault("y", result)
        timers[name] = lambda f=function, r=result: f.calls(given, r, turns)
    np.testing.assert_allclose(found["forward_dynamics"], given["qdd"], atol=1e-7)
    robot, out = case.cpp, np.zeros(shape)
    if robot is not None:
        q, qd, y = case.theirs((given["q"], given["qd"], given["y"]))
        robot.aba((q, qd, y), out)
        # Pinocchio has the decimals of the file
        size = np.abs(given["qdd"]).max()
        np.testing.assert_allclose(out, case.theirs(states)[2], atol=1e-2 * size)
        timers["ABA"] = lambda: robot.aba((q, qd, y), out, turns)
    calls = {name: (turns * _STATES, timer) for name, timer in timers.items()}
    rounds = interleaved_rounds(calls, repeats)
    cells = [f"{rounds.per_sample(name).median:.0f}" for name in timers]
    factor = rounds.ratio("slotine_li", "inverse_dynamics")
    targets = []
    if case.name == "ur10":
        title = "UR10: Slotine and Li's forces by inverse dynamics"
        targets.append(Target(title, factor.median, SLOWER, "×"))
    ratios = [str(factor), "–"]
    if robot is not None:
        share = rounds.ratio("forward_dynamics", "ABA")
        title = f"{case.label}: forward dynamics by Pinocchio's ABA"
        targets.append(Target(title, share.median, 1.0, "×"))
        ratios[1] = str(share)
    return [case.label, *cells, *[""] * (4 - len(cells)), *ratios], targets


def main(repeats: int = 15) -> int:
    """Print the tables; the exit status."""
    cases = [
        urdf_case("ur10", "UR10", "ur10_robot.urdf"),
        urdf_case("xarm7", "xArm 7", "xarm7.urdf"),
        urdf_case("talos", "Talos, 32 joints", "talos_reduced.urdf"),
    ]
    rows, targets = [], []
    for case in cases:
        cells, own = row(case, repeats)
        rows.append(cells)
        targets += own
    head = ["robot", *(f"{name}, ns" for name in FUNCTIONS), "Pinocchio's ABA, ns"]
    print(
        table([*head, "slotine_li / inverse_dynamics", "forward_dynamics / ABA"], rows)
    )
    print(table(["target", "reached", "limit", ""], [t.cells() for t in targets]))
    return int(not all(target.passed for target in targets))


if __name__ == "__main__":
    raise SystemExit(main(*map(int, sys.argv[1:])))
