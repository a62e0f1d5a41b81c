"""The worked changes of CONTRIBUTING.md, applied to a copy of the source and used."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from support.system_tools import tool

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^```(diff|python|jinja)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
ARM = """
echelon: 1
name: arm
bodies:
  - {name: one, joint: {name: j1, type: revolute, axis: y}}
  - {name: two, parent: one, joint: {name: j2, type: revolute, axis: y, origin: {xyz: [0.5, 0, 0.1]}}}
"""


def apply_diff(text: str, root: Path) -> None:
    """Replace lines: those with a blank or ``-`` stand in the file, as lines or parts of lines."""
    for part in re.split(r"^--- ", text, flags=re.MULTILINE)[1:]:
        name, _, body = part.partition("\n")
        path = root / name.strip()
        content = path.read_text(encoding="utf-8")
        for hunk in body.rstrip("\n").split("\n@@\n"):
            lines = hunk.split("\n")
            old = "\n".join(line[1:] for line in lines if not line.startswith("+"))
            new = "\n".join(line[1:] for line in lines if not line.startswith("-"))
            assert content.count(old) == 1, (
                f"{name} holds this {content.count(old)} times: {old}"
            )
            content = content.replace(old, new)
        path.write_text(content, encoding="utf-8")


@pytest.fixture(scope="module")
def changed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a copy of the source with all changes."""
    root = tmp_path_factory.mktemp("changed")
    shutil.copytree(ROOT / "src", root / "src")
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = text[text.index("## Five changes") : text.index("## Tests")]
    for language, block in BLOCK.findall(section):
        if language == "diff":
            apply_diff(block, root)
            continue
        first, _, content = block.partition("\n")
        (path,) = re.findall(r"src/\S+", first)
        (root / path).write_text(content, encoding="utf-8")
    return root


def run(changed: Path, *command: str) -> str:
    environment = os.environ | {"PYTHONPATH": str(changed / "src")}
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        env=environment,
        cwd=changed,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def echelon(changed: Path, *arguments: str) -> str:
    return run(changed, sys.executable, "-m", "echelon", *arguments)


def described(changed: Path, name: str, more: str, text: str = ARM) -> str:
    path = changed / f"{name}.yaml"
    path.write_text(text + more, encoding="utf-8")
    return str(path)


def test_a_gimbal_sees_what_a_ball_sees(changed: Path) -> None:
    """Under gravity along z: nine base parameters of one body."""
    text = "echelon: 1\nname: top\nbodies: [{name: one, joint: {name: j, type: %s}}]\n"
    robots = [
        described(changed, kind, "", text % kind) for kind in ("gimbal", "spherical")
    ]
    script = f"import echelon as ec; print([ec.base_structure(ec.load(robot)).rank for robot in {robots}])"
    assert json.loads(run(changed, sys.executable, "-c", script)) == [9, 9]


def test_a_friction_law_gets_columns(changed: Path) -> None:
    robot = described(changed, "drag", "effects: [{type: drag, at: all}]\n")
    found = json.loads(echelon(changed, "derive", robot, "--json"))
    assert {"Fq1", "Fq2"} <= {entry["name"] for entry in found["base"]}


def test_a_load_pin_measures_a_component_of_the_wrench(changed: Path) -> None:
    """Two pins across each other see what force sensors there see; the independent verifier checks the set."""
    outputs = "outputs: [{pin: two, x: 3/5, z: 4/5}, {wrench: two, components: [fz]}]\n"
    saved = changed / "pin.json"
    saved.write_text(
        echelon(changed, "derive", described(changed, "pin", outputs), "--json")
    )
    assert "independent verifier: valid" in echelon(changed, "verify", str(saved))
    forces = described(
        changed, "forces", "outputs: [{wrench: two, components: [fx, fz]}]\n"
    )
    assert (
        json.loads(saved.read_text())["rank"] == ec.base_structure(ec.load(forces)).rank
    )
    wrong = described(changed, "wrong", "outputs: [{pin: too, x: 3/5, z: 4/5}]\n")
    script = f"""
import echelon as ec
try:
    ec.load({wrong!r})
except ec.InputError as error:
    print(error)
"""
    assert "outputs[0].pin: there is no" in run(changed, sys.executable, "-c", script)


def test_json_lines_are_read(changed: Path) -> None:
    rows = [{"t": k / 10, "q1": k / 7} for k in range(5)]
    (changed / "log.jsonl").write_text("\n".join(map(json.dumps, rows)))
    script = """
from echelon.identification.logs.files.open_log import open_log
(table,) = open_log("log.jsonl").tables()
print(table.columns["q1"].tolist())
"""
    assert json.loads(run(changed, sys.executable, "-c", script)) == [
        row["q1"] for row in rows
    ]


def test_javascript_computes_what_the_library_computes(changed: Path) -> None:
    node = tool("node")
    robot = described(changed, "arm", "effects: [{type: coulomb, at: j1}]\n")
    echelon(changed, "generate", robot, "--target", "javascript", "-o", "js")
    (source,) = (changed / "js").glob("*.js")
    source.rename(source.with_suffix(".mjs"))
    mechanism = ec.load(robot)
    base = ec.base_parameters(mechanism)
    q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, 2))
    values = np.linspace(1, 2, base.rank)
    called = ", ".join(json.dumps(part.tolist()) for part in (q, qd, qdd, values))
    call = f"console.log(JSON.stringify(arm.inverse_dynamics({called})));"
    (changed / "call.mjs").write_text(
        f"import * as arm from './js/{source.stem}.mjs'; {call}"
    )
    expected = base.regressor(q, qd, qdd) @ values
    np.testing.assert_allclose(
        json.loads(run(changed, node, "call.mjs")), np.ravel(expected), rtol=1e-12
    )
