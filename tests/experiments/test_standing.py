"""A biped that stands on one foot, on the other and on both: its stances are experiments with logs of their own."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import SubElement, parse, tostring

import numpy as np
import pytest

import echelon as ec
from echelon.identification.estimators.least_squares import noise_estimate
from echelon.identification.logs.recording import Samples
from echelon.identification.rows.rows import ModelRows
from support.robot_files import robot_file
from support.standing_robot import biped_mjcf, log_standing

FOOT = "0 0 -0.3"
STANCES = {"left": ["left"], "right": ["right"], "both": ["left", "right"]}
SETUP = """echelon: 1
robot: biped.xml
effects: none
contacts:
  - {name: left, body: left_shank, at: {xyz: [0, 0, -0.3]}}
  - {name: right, body: right_shank, at: {xyz: [0, 0, -0.3]}}
experiments:
  - {name: left, contacts: [left]}
  - {name: right, contacts: [right]}
  - {name: both}
log:
  time: t
  position: {trunk.tx: x, trunk.ty: y, trunk.tz: z, trunk.r.w: qw, trunk.r.x: qx, trunk.r.y: qy, trunk.r.z: qz,
             all: "q_{name}"}
  output: "tau_{name}"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("biped")
    (found / "biped.xml").write_text(biped_mjcf(np.random.default_rng(3)))
    (found / "biped.yaml").write_text(SETUP)
    for seed, (name, feet) in enumerate(STANCES.items()):
        held = [(f"{foot}_shank", FOOT) for foot in feet]
        log_standing(found / "biped.xml", held, found / f"{name}.csv", 8.0, seed)
    return found


def test_stances_are_experiments(folder: Path) -> None:
    logs = [folder / f"{name}.csv" for name in STANCES]
    result = ec.identify(folder / "biped.yaml", logs)
    expected, (low, high) = result.base.values(), result.estimate.interval(0.95).T
    assert np.mean((expected > low) & (expected < high)) > 0.88
    assert np.median(result.estimate.std / np.maximum(abs(expected), 0.01)) < 0.05
    assert not result.reasons
    assert "left.right_knee" in {score.output for score in result.pooled[-1].scores}
    assert any("pushes the floating base" in f.text for f in result.findings)


def test_noise_of_rows_without_contact_forces_is_that_of_the_outputs(
    folder: Path,
) -> None:
    """Forces at two feet take six of twelve dimensions off each sample, and their noise with them."""
    base = ec.base_parameters(ec.load(folder / "biped.yaml", experiment="both"))
    rng, count = np.random.default_rng(2), 400
    q = rng.normal(size=(count, len(base.mechanism.positions)))
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    qd, qdd = rng.normal(size=(2, count, len(base.mechanism.velocities)))
    slips = base.evaluate("contact_jacobian", {"q": q})
    forces = np.einsum("kcn,kc->kn", slips, 50 * rng.normal(size=slips.shape[:2]))
    y = base.regressor(q, qd, qdd) @ rng.normal(size=base.rank) - forces
    y += 0.3 * rng.normal(size=y.shape)
    rows = ModelRows.of(base, [Samples("run", 0.0, 100.0, q, qd, qdd, y)]).observation()
    assert rows.counts == (6 * count,)
    assert noise_estimate(rows) == pytest.approx([0.3], rel=0.05)


HUMANOID = """echelon: 1
robot: talos.urdf
effects: none
contacts:
  - {name: left, type: surface, body: left_sole_link}
  - {name: right, type: surface, body: right_sole_link}
experiments:
  - {name: left, contacts: [left]}
  - {name: right, contacts: [right]}
  - {name: both}
log:
  time: t
  position: {base.tx: x, base.ty: y, base.tz: z, base.r.w: qw, base.r.x: qx, base.r.y: qy, base.r.z: qz,
             all: "q_{name}"}
  output: "tau_{name}"
identification: {physical: false, essential: none}
"""


@pytest.mark.slow
def test_stances_of_a_humanoid_are_experiments(tmp_path: Path) -> None:
    root = parse(robot_file("talos_reduced")).getroot()
    for link in root.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
    for element in [e for e in root if e.tag not in ("link", "joint")]:
        root.remove(element)
    (tmp_path / "talos.urdf").write_text(tostring(root).decode())
    (tmp_path / "talos.yaml").write_text(HUMANOID)
    compiler = SubElement(SubElement(root, "mujoco"), "compiler")
    compiler.set("fusestatic", "false")
    (tmp_path / "simulated.urdf").write_text(tostring(root).decode())
    logs = [tmp_path / f"{name}.csv" for name in STANCES]
    for seed, feet in enumerate(STANCES.values()):
        held = [(f"{foot}_sole_link", "") for foot in feet]
        log_standing(tmp_path / "simulated.urdf", held, logs[seed], 6.0, seed)
    setup = ec.load_setup(tmp_path / "talos.yaml", floating=True)
    result = ec.identify(setup, logs)
    assert result.base.rank == 234  # as in the air
    expected, (low, high) = result.base.values(), result.estimate.interval(0.95).T
    assert np.mean((expected > low) & (expected < high)) > 0.85


def test_what_a_log_of_a_floating_robot_lacks_is_named(folder: Path) -> None:
    text = SETUP.replace("trunk.r.w: qw, ", "")
    (folder / "lacking.yaml").write_text(text)
    with pytest.raises(ec.InputError, match=r"trunk\.r\.w"):
        ec.identify(folder / "lacking.yaml", folder / "left.csv")
