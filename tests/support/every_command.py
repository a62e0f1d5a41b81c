"""Every command of the command line on small robots, run one after another in one process.

``python every_command.py`` runs them in the current folder, and keeps what each says in ``NAME.out``; ``python
every_command.py NAME…`` runs some of them.
"""

from __future__ import annotations

import io
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from echelon.codegen import TARGETS
from support.paths import ROOT

ARM = """
echelon: 1
name: arm
symbols: {l1: 0.3, g: 9.81}
gravity: [0, -g, 0]
modified_dh:
  - {joint: revolute, name: j1, inertial: {mass: 2, com: [0.15, 0, 0], inertia: {xx: 0.02, yy: 0.02, zz: 0.02}}}
  - {joint: revolute, name: j2, a: l1, inertial: {mass: 1, com: [0.15, 0, 0], inertia: {xx: 0.01, yy: 0.01, zz: 0.01}}}
effects: [{type: viscous, at: all}, {type: coulomb, at: all}]
log: {time: t, position: "q{n}", output: "tau{n}"}
excitation:
  duration: 3
  harmonics: 2
  starts: 1
  iterations: 30
  limits: {position: [-2, 2], velocity: 3, acceleration: 20, jerk: 400, effort: {j1: 12, j2: 5}}
  frames: [{body: j2, point: [0.3, 0, 0], box: {x: [-0.55, none]}}]
  collisions: {shapes: [{body: j2, sphere: 0.1}], obstacles: [{name: post, sphere: 0.1, at: [0.9, 0, 0]}]}
"""
URDF = """<robot name="gripper"><link name="base"/>
<link name="finger"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="thumb"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="finger"/><axis xyz="0 0 1"/>
<origin rpy="1.5708 0 0.3"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="finger"/><child link="thumb"/><axis xyz="0 1 0"/>
<origin xyz="0.3 0.01 0" rpy="0 0.7 0"/><mimic joint="j1" multiplier="-1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>
"""
LOOP = (ROOT / "examples" / "loops" / "four_bar.yaml").read_text(encoding="utf-8")
LINEAR = (ROOT / "examples" / "linear" / "arrhenius.yaml").read_text(encoding="utf-8")
CLAIMED = "ZZ1 + l1^2*M2\nMX1 + l1*M2\nMY1\nZZ2\nMX2\n"
LANGUAGES = tuple(TARGETS)
SCHEMAS = (
    "description",
    "base-model",
    "linear-base",
    "identified",
    "trajectory",
    "comparison",
    "calibration",
)

COMMANDS = {
    "text": "derive arm.yaml",
    "json": "derive arm.yaml --json -o arm.json",
    "latex": "derive arm.yaml --format latex",
    "markdown": "derive gripper.urdf --format markdown --numeric",
    "urdf": "derive gripper.urdf --json",
    "structure": "derive gripper.urdf --rank-only --json",
    "loop": "derive loop.yaml --json",
    "structure-loop": "derive loop.yaml --rank-only",
    "special": "derive arm.yaml --special --json",
    "numeric": "derive arm.yaml --compare-numeric --json",
    "regressor-latex": "derive arm.yaml --regressor latex",
    "regressor-sympy": "derive loop.yaml --regressor sympy",
    "linear": "derive linear.yaml --json",
    "verify": "verify arm.json --seed 7 --json",
    "sensors": "sensors arm.yaml --size 2 --json",
    "audit": "audit arm.yaml claimed.txt --json",
    "compare": "compare arm.yaml arm.yaml --json",
    "calibrate": "calibrate arm.yaml --json",
    **{
        f"generate-{name}": f"generate arm.yaml --target {name} -o code-{name} --json"
        for name in LANGUAGES
    },
    "generate-loop": "generate loop.yaml --function regressor --target c -o code-loop",
    "excite": "excite arm.yaml -o motion --format csv --format parquet --format yaml --rate 200",
    "excite-json": "excite arm.yaml --criterion condition --family bspline --segments 6 --json",
    "excite-loop": "excite loop.yaml --duration 3 --harmonics 2 --starts 1 --iterations 10 --json",
    "check": "check-trajectory arm.yaml motion/trajectory.csv -o check.html --json",
    "setup": "setup gripper.urdf run1.csv",
    "what-logs-show": "check arm.yaml run1.csv --json",
    "identify": "identify arm.yaml run1.csv run2.csv -o identified",
    "identify-json": "identify arm.yaml run1.csv --estimator huber --no-physical --target none --json",
    "complement": "excite arm.yaml --prior-log run1.csv --starts 1 --iterations 5 --json",
    "predict": "predict identified/model.json run1.csv -o predicted.csv --json",
    "predict-parquet": "predict identified/model.json run1.csv -o predicted.parquet",
    **{f"schema-{name}": f"schema {name}" for name in SCHEMAS},
}
"""Command lines by name, in an order in which each finds the files that it reads."""


def write_inputs(folder: Path) -> None:
    """The files that the commands read."""
    import numpy as np

    import echelon as ec

    texts = {
        "arm.yaml": ARM,
        "gripper.urdf": URDF,
        "loop.yaml": LOOP,
        "linear.yaml": LINEAR,
        "claimed.txt": CLAIMED,
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    base = ec.base_parameters(ec.load(folder / "arm.yaml"))
    values = np.linspace(0.2, 0.6, base.rank)
    for number in (1, 2):
        rng, t = np.random.default_rng(number), np.arange(2000) / 200
        sizes, rates, phases = rng.uniform((0.2, 1, 0), (0.5, 7, 6), (4, 2, 3)).T[
            :, :, :, None
        ]
        angle = rates * t + phases
        q, qd, qdd = (
            np.sum(part, axis=1).T
            for part in (
                sizes * np.sin(angle),
                sizes * rates * np.cos(angle),
                -sizes * rates**2 * np.sin(angle),
            )
        )
        tau = base.predict(q, qd, qdd, values) + 0.01 * rng.normal(size=q.shape)
        table = np.column_stack([t, q, tau])
        np.savetxt(
            folder / f"run{number}.csv",
            table,
            delimiter=",",
            header="t,q1,q2,tau1,tau2",
            comments="",
        )


def run(name: str) -> None:
    """One command in the current folder; what it says goes to ``NAME.out``."""
    from echelon.cli import main

    sys.argv = ["echelon", *COMMANDS[name].split()]
    out, err, code = io.StringIO(), io.StringIO(), 0
    with redirect_stdout(out), redirect_stderr(err):
        try:
            main()
        except SystemExit as ended:
            code = int(ended.code or 0)
    Path(f"{name}.out").write_text(
        f"{out.getvalue()}{err.getvalue()}exit code {code}\n", encoding="utf-8"
    )


if __name__ == "__main__":
    for chosen in sys.argv[1:] or COMMANDS:
        run(chosen)
