"""Robots that were identified from simulated logs, as files in MuJoCo and Pinocchio, against the true torques."""

from __future__ import annotations

import numpy as np
import pytest

import echelon as ec
from echelon.cli.destination import MANIFEST
from support.simulated_results import assert_predicts, assert_same, params, result_of
from support.simulated_systems import motion_of
from support.written_robots import pinocchio_efforts, standard

_ARMATURES = ("Ia1", "Ia2", "Ia3")
"""Rotors of the geared arm that turn with one joint each, so that MJCF has a place for them."""


@pytest.mark.parametrize("name", params())
def test_written_files(name: str) -> None:
    result = result_of(name)
    names = {path.name for path in result.folder.iterdir()} - {MANIFEST}
    robots = {
        "description": {"identified.yaml", "identified.urdf"},
        "urdf": {"identified.urdf"},
        "mjcf": {"identified.xml"},
    }
    assert names == {
        "model.json",
        "report.html",
        "model.c",
        "model.h",
        *robots[result.system.robot],
    }


@pytest.mark.parametrize("name", params())
def test_the_physical_robot_is_one(name: str) -> None:
    """Every body has a positive mass, and moments of inertia that masses can have."""
    result = result_of(name)
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
    assert all(
        v >= 0
        for c, v in zip(mechanism.columns, result.physical, strict=True)
        if c.body is None
    )


@pytest.mark.parametrize("name", params("mjcf"))
def test_mjcf_in_mujoco(name: str) -> None:
    """The written model needs the torques that the true one needs, but for effects that MJCF cannot say."""
    result = result_of(name)
    motion, text = result.fresh, result.text("identified.xml")
    written = result.system.inverse(text, motion.q, motion.qd, motion.qdd)
    lacking = ("Fv4", "Fc4", "Ia4") if result.system.name == "motor side" else ()
    assert all(f"{name} = " in text for name in lacking)
    kept = np.array([name in lacking for name in result.base.mechanism.parameters])
    written += (
        result.base.standard_regressor(*result.states(motion))[..., kept]
        @ result.physical[kept]
    )
    assert_same(
        written,
        result.base.standard_regressor(*result.states(motion)) @ result.physical,
    )
    assert_predicts(result, written)


@pytest.mark.parametrize("name", params("urdf", "description"))
@pytest.mark.slow
def test_urdf_in_pinocchio(name: str) -> None:
    """Friction, which Pinocchio's inverse dynamics leaves out, is added by the identified values."""
    result = result_of(name)
    motion, floating = result.fresh, bool(result.system.reading)
    states = result.states(motion)
    efforts = pinocchio_efforts(
        result.base.mechanism, result.text("identified.urdf"), states, floating
    )
    efforts += result.effects(motion)
    assert_same(efforts, result.base.standard_regressor(*states) @ result.physical)
    assert_predicts(result, efforts)


@pytest.mark.parametrize("name", ["arm"])
@pytest.mark.slow
def test_urdf_in_mujoco(name: str) -> None:
    """MuJoCo reads viscous and dry friction from URDF; rotors' inertia has no place there."""
    result = result_of(name)
    motion, text = result.fresh, result.text("identified.urdf")
    written = result.system.inverse(text, motion.q, motion.qd, motion.qdd)
    rotors = np.array(
        [name.startswith("Ia") for name in result.base.mechanism.parameters]
    )
    written += (
        result.base.standard_regressor(*result.states(motion))[..., rotors]
        @ result.physical[rotors]
    )
    assert_predicts(result, written)


@pytest.mark.parametrize(
    "name", [some for some in params("mjcf") if some.values != ("five-bar",)]
)
def test_mjcf_in_pinocchio(name: str) -> None:
    """Pinocchio reads the bodies and armatures of MJCF files as well."""
    result = result_of(name)
    import pinocchio as pin

    model = pin.buildModelFromMJCF(str(result.folder / "identified.xml"))
    data, motion = model.createData(), result.fresh
    assert model.nv == 4
    efforts = [
        pin.rnea(model, data, *state)
        for state in zip(motion.q, motion.qd, motion.qdd, strict=True)
    ]
    mechanism = result.base.mechanism
    kept = np.array(
        [
            c.body is not None or n in _ARMATURES
            for c, n in zip(mechanism.columns, mechanism.parameters, strict=True)
        ]
    )
    expected = (
        result.base.standard_regressor(*result.states(motion))[..., kept]
        @ result.physical[kept]
    )
    if result.system.name == "motor side":
        expected = expected @ result.system.rates  # τ_q = Tᵀ τ_θ
    assert_same(np.array(efforts), expected[:, :4])


@pytest.mark.parametrize("name", params("description"))
def test_description_reads_back(name: str) -> None:
    result = result_of(name)
    again = ec.load(result.folder / "identified.yaml")
    assert again.parameters == result.base.mechanism.parameters
    np.testing.assert_allclose(standard(again), result.physical, rtol=1e-9, atol=1e-12)


def test_band_speeds_and_left_out_rows_are_part_of_the_model() -> None:
    """They stand in the verdict, in model.json, in the report and at the head of the code, for every output."""
    result = result_of("arm")
    motion = motion_of(result.system)
    ranges = result.document["ranges"]
    names = [output.name for output in result.base.mechanism.outputs]
    assert [found["output"] for found in ranges] == names
    for k, found in enumerate(ranges):
        assert found["band"] == result.document["preparation"]["band"]
        assert (
            found["rows"] - found["left_out"]
            == result.document["estimate"]["rows"][found["output"]]
        )
        assert found["slowest"] == result.document["preparation"]["still"]
        fastest = np.abs(
            motion.qd[:, k]
        ).max()  # in the whole log, of which a part is fitted
        assert 0.5 * fastest < found["fastest"] < 1.05 * fastest
        words = f"{found['output']} up to {found['fastest']:.3g} rad/s"
        assert words in result.document["verdict"]
        assert words in result.text("model.h")
    assert "What every output was fitted to" in result.text("report.html")
