"""Simulated robots, from their logs through the command line to files: the truth is known, so everything is compared."""

from __future__ import annotations

import csv
import ctypes
import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import echelon as ec
from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.identify.identification import Identification
from echelon.identify.model_rows import rows_taken
from echelon.identify.run import identify
from echelon.identify.setup import load_setup
from echelon.results.identified import IdentifiedModel, load_identified
from generated import compiled, tool
from simulated import SYSTEMS, Motion, System, closure, motion_of
from simulated_models import Floats
from test_cli import run
from written import pinocchio_efforts, reread, standard

FRESH = 12
"""Seed of a motion that nobody has seen."""
_ARMATURES = ("Ia1", "Ia2", "Ia3")
"""Rotors of the geared arm that turn with one joint each, so that MJCF has a place for them."""
QUICK = ("arm", "five-bar")
PARAMS = [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in SYSTEMS]


@dataclass(frozen=True)
class Result:
    """A system, what ``echelon identify`` wrote about it, and the truth."""

    system: System
    folder: Path
    model: IdentifiedModel
    truth: Floats
    said: str

    @property
    def base(self) -> BaseModel:
        return self.model.base

    @cached_property
    def document(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.text("model.json"))
        return found

    @cached_property
    def covariance(self) -> Floats:
        return np.array(self.document["estimate"]["covariance"])

    @cached_property
    def physical(self) -> Floats:
        """Standard parameters of the physically consistent fit."""
        return np.array(list(self.document["physical"]["standard"].values()))

    @cached_property
    def fresh(self) -> Motion:
        """Some states of a new motion, where all joints are fast enough to tell which way friction acts."""
        motion = motion_of(self.system, FRESH)
        fast = np.flatnonzero((np.abs(motion.qd[:, -len(self.system.rates.T) :]) > 0.15).all(axis=1))
        return motion.at(fast[:: len(fast) // 100])

    def text(self, name: str) -> str:
        return (self.folder / name).read_text()

    def states(self, motion: Motion) -> tuple[Floats, Floats, Floats]:
        """As the regressor takes them."""
        samples = self.system.samples(motion)
        return samples.q, samples.qd, samples.qdd

    def uncertainty(self, motion: Motion) -> Floats:
        """Root mean square, for each output, of the standard deviation of the predictions."""
        X = self.base.regressor(*self.states(motion))
        variance = np.einsum("ijk,kl,ijl->ij", X, self.covariance, X)
        found: Floats = np.sqrt(variance.mean(axis=0))
        return found

    def effects(self, motion: Motion) -> Floats:
        """What effects contribute to the outputs, by the identified values."""
        values = [0.0 if c.body is not None else v for c, v in zip(self.base.mechanism.columns, self.physical, strict=True)]
        found: Floats = self.base.standard_regressor(*self.states(motion)) @ np.array(values)
        return found


@pytest.fixture(scope="module", params=PARAMS)
def result(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A system after ``echelon identify`` on a noisy log."""
    return identified(SYSTEMS[request.param], tmp_path_factory.mktemp("system"))


def identified(system: System, folder: Path) -> Result:
    """What the command line makes of a set-up file and a log."""
    (folder / "true").mkdir()
    base, values = system.truth(folder / "true")
    setup = system.write_setup(folder)
    log = system.log(motion_of(system), folder / "run", base.mechanism)
    options = [f"--{name.replace('_', '-')}" for name in system.reading]
    done = run("identify", str(setup), str(log), "-o", str(folder / "result"), *options)
    assert done.returncode == 0, done.stderr
    model = load_identified(folder / "result" / "model.json")
    assert model.base.pivots == base.pivots
    return Result(system, folder / "result", model, base.values(values), done.stdout)


def rms(values: Floats) -> Floats:
    found: Floats = np.sqrt(np.mean(values**2, axis=0))
    return found


def assert_predicts(result: Result, predicted: Floats, times: float = 4.0) -> None:
    """The exact outputs of a fresh motion, to within a few standard deviations of what noise does to predictions."""
    motion = result.fresh
    ratio = rms(predicted - motion.y) / result.uncertainty(motion)
    assert (ratio < times).all(), ratio
    assert (result.uncertainty(motion) < 0.05 * rms(motion.y - motion.y.mean(axis=0))).all()


def assert_same(found: Floats, expected: Floats, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())


# -- the estimate --------------------------------------------------------------------------------------------------------


def test_estimates_are_the_truth_to_within_their_deviations(result: Result) -> None:
    estimate = result.document["estimate"]
    values = np.array([entry["value"] for entry in estimate["parameters"]])
    errors = (values - result.truth) / np.sqrt(np.diagonal(result.covariance))
    assert np.abs(errors).max() < 5
    assert np.mean(errors**2) < 2.5
    inside = [low <= truth <= high for (low, high), truth in zip(intervals(estimate), result.truth, strict=True)]
    assert np.mean(inside) > 0.75


def intervals(estimate: dict[str, Any]) -> list[tuple[float, float]]:
    return [(entry["low"], entry["high"]) for entry in estimate["parameters"]]


def test_the_summary_says_that_all_is_well(result: Result) -> None:
    document = result.document
    assert document["excitation"]["rank"] == result.base.rank
    assert document["feasibility"]["feasible"] is True
    scores = [score for v in document["validations"] if v["role"] == "validation" for score in v["scores"]]
    assert len(scores) == len(result.system.noise)
    assert min(score["r2"] for score in scores) > 0.98
    assert "stranger" not in {finding["kind"] for finding in document["findings"]}
    assert (result.folder / "report.html").stat().st_size > 10_000


def test_noise_is_found(result: Result) -> None:
    """What is left of white noise after the low-pass of both sides: its share of the band."""
    motion = motion_of(result.system)
    nyquist = 0.5 / (motion.time[1] - motion.time[0])
    share = np.sqrt(result.model.preparation.output_cutoff / nyquist)
    noise = np.array([result.document["estimate"]["noise"][o.name] for o in result.base.mechanism.outputs])
    ratio = noise / share / result.system.noise
    assert (ratio > 0.9).all(), ratio
    assert (ratio < 1.4).all(), ratio


# -- predictions ---------------------------------------------------------------------------------------------------------


def test_fresh_motions_are_predicted(result: Result) -> None:
    states = result.states(result.fresh)
    assert_predicts(result, result.base.predict(*states, result.model.values))
    assert_predicts(result, result.base.standard_regressor(*states) @ result.physical)


def test_predict_command(result: Result, tmp_path: Path) -> None:
    """``echelon predict`` gives the model's outputs at the prepared samples of a log, filtered like the measured ones."""
    log = result.system.log(motion_of(result.system, FRESH), tmp_path / "fresh", result.base.mechanism, seed=None)
    done = run("predict", str(result.folder / "model.json"), str(log), "-o", str(tmp_path / "out.csv"), "--json")
    assert done.returncode == 0, done.stderr
    with (tmp_path / "out.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    (samples,) = result.model.plan.samples(log, outputs=False)
    exact = result.base.predict(samples.q, samples.qd, samples.qdd, result.model.values)
    for (times, values), output in zip(
        rows_taken(replace(samples, moving=None), exact), result.base.mechanism.outputs, strict=True
    ):
        np.testing.assert_allclose([float(row["time"]) for row in rows], times, atol=1e-9)
        assert_same(np.array([float(row[f"{output.name}.predicted"]) for row in rows]), values)
    scores = json.loads(done.stdout)["outputs"].values()
    assert min(score["r2"] for score in scores) > 0.98


def test_compiled_code_is_the_model(result: Result, tmp_path: Path) -> None:
    library = tmp_path / "model.so"
    source = str(result.folder / "model.c")
    code = compiled([tool("gcc"), "-O1", "-shared", "-fPIC", source, "-o", str(library), "-lm"], library)
    motion = result.fresh
    expected = result.base.predict(*result.states(motion), result.model.values)
    assert_same(called(code, result.system, motion, expected.shape[1]), expected)


def called(code: ctypes.CDLL, system: System, motion: Motion, outputs: int) -> Floats:
    """Inverse dynamics of C at all states; with loops, the power in each virtual motion of a drive."""
    found = np.full((len(motion.time), outputs), np.nan)
    for k, state in enumerate(zip(motion.q, motion.qd, motion.qdd, strict=True)):
        if not system.independent:
            code.model_inverse_dynamics(*map(_pointer, state), _pointer(found[k]))
            continue
        for output, virtual in enumerate(_virtual(system, state[0])):
            rest = (np.eye(outputs)[output], virtual, found[k, output : output + 1])
            code.model_inverse_dynamics(*map(_pointer, (*state, *rest)))
    return found


def _pointer(values: Floats) -> ctypes.c_void_p:
    return values.ctypes.data_as(ctypes.c_void_p)


def _virtual(system: System, q: Floats) -> Floats:
    """Velocities of all joints when one drive turns, shape (drives, joints)."""
    model = mujoco.MjModel.from_xml_string(system.mjcf())
    data = mujoco.MjData(model)
    data.qpos[:] = q
    J, chosen = closure(model, data)[0], list(system.independent)
    others = [k for k in range(model.nv) if k not in chosen]
    found = np.zeros((len(chosen), model.nv))
    found[:, chosen] = np.eye(len(chosen))
    found[:, others] = -np.linalg.lstsq(J[:, others], J[:, chosen], rcond=None)[0].T
    return found


# -- files ---------------------------------------------------------------------------------------------------------------


def test_written_files(result: Result) -> None:
    names = {path.name for path in result.folder.iterdir()}
    robots = {"description": {"robot.yaml", "robot.urdf"}, "urdf": {"robot.urdf"}, "mjcf": {"robot.xml"}}
    assert names == {"model.json", "report.html", "model.c", "model.h", *robots[result.system.robot]}


def test_the_physical_robot_is_one(result: Result) -> None:
    """Every body has a positive mass, and moments of inertia that masses can have."""
    mechanism = result.base.mechanism
    for k, body in enumerate(mechanism.bodies):
        ten = result.physical[mechanism.first_column[k] :][:10]
        assert ten[9] > 0, body.name
        xx, xy, xz, yy, yz, zz = ten[:6]
        centre = ten[6:9] / ten[9]
        about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        about -= ten[9] * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        least, middle, largest = np.linalg.eigvalsh(about)
        assert least > 0
        assert least + middle >= largest
    assert all(v >= 0 for c, v in zip(mechanism.columns, result.physical, strict=True) if c.body is None)


def test_mjcf_in_mujoco(result: Result) -> None:
    """The written model needs the torques that the true one needs, but for effects that MJCF cannot say."""
    if result.system.robot != "mjcf":
        pytest.skip("the robot came as another format")
    motion, text = result.fresh, result.text("robot.xml")
    written = result.system.inverse(text, motion.q, motion.qd, motion.qdd)
    lacking = ("Fv4", "Fc4", "Ia4") if result.system.name == "motor side" else ()
    assert all(f"{name} = " in text for name in lacking)
    kept = np.array([name in lacking for name in result.base.mechanism.parameters])
    written += result.base.standard_regressor(*result.states(motion))[..., kept] @ result.physical[kept]
    assert_same(written, result.base.standard_regressor(*result.states(motion)) @ result.physical)
    assert_predicts(result, written)


def test_urdf_in_pinocchio(result: Result) -> None:
    """Friction, which Pinocchio's inverse dynamics leaves out, is added by the identified values."""
    if result.system.robot == "mjcf":
        pytest.skip("the robot came as another format")
    motion, floating = result.fresh, bool(result.system.reading)
    states = result.states(motion)
    efforts = pinocchio_efforts(result.base.mechanism, result.text("robot.urdf"), states, floating)
    efforts += result.effects(motion)
    assert_same(efforts, result.base.standard_regressor(*states) @ result.physical)
    assert_predicts(result, efforts)


def test_urdf_in_mujoco(result: Result) -> None:
    """MuJoCo reads viscous and dry friction from URDF; rotors' inertia has no place there."""
    if result.system.name != "arm":
        pytest.skip("URDF of a fixed base only")
    motion, text = result.fresh, result.text("robot.urdf")
    written = result.system.inverse(text, motion.q, motion.qd, motion.qdd)
    rotors = np.array([name.startswith("Ia") for name in result.base.mechanism.parameters])
    written += result.base.standard_regressor(*result.states(motion))[..., rotors] @ result.physical[rotors]
    assert_predicts(result, written)


def test_mjcf_in_pinocchio(result: Result) -> None:
    """Pinocchio reads the bodies and armatures of MJCF files as well."""
    if result.system.name not in ("wrist sensor", "motor side"):
        pytest.skip("an open chain that came as MJCF")
    pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed")
    model = pin.buildModelFromMJCF(str(result.folder / "robot.xml"))
    data, motion = model.createData(), result.fresh
    assert model.nv == 4
    efforts = [pin.rnea(model, data, *state) for state in zip(motion.q, motion.qd, motion.qdd, strict=True)]
    mechanism = result.base.mechanism
    kept = np.array([c.body is not None or n in _ARMATURES for c, n in zip(mechanism.columns, mechanism.parameters, strict=True)])
    expected = result.base.standard_regressor(*result.states(motion))[..., kept] @ result.physical[kept]
    if result.system.name == "motor side":
        expected = expected @ result.system.rates  # τ_q = Tᵀ τ_θ
    assert_same(np.array(efforts), expected[:, :4])


def test_description_reads_back(result: Result) -> None:
    if result.system.robot != "description":
        pytest.skip("the robot came as another format")
    again = ec.load(result.folder / "robot.yaml")
    assert again.parameters == result.base.mechanism.parameters
    np.testing.assert_allclose(standard(again), result.physical, rtol=1e-9, atol=1e-12)
