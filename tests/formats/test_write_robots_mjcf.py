"""Written MJCF files against MuJoCo, which reads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.formats.robot_file import open_robot
from echelon.formats.snapping import ReadingOptions
from echelon.formats.writers.robot_writer import WrittenRobot, identified_robot
from support.float_regressor import float_regressor, random_states
from support.paths import EXAMPLES
from support.written_robots import (
    assert_near,
    geometry,
    random_parameters,
    reread,
    standard,
)

BODY = '<inertial pos="0.05 -0.02 0.11" mass="1.3" euler="0.2 0.3 -0.4" diaginertia="0.021 0.017 0.012"/>'
MJCFS = {
    "one body, several joints": f"""<mujoco><compiler angle="radian"/><worldbody><geom type="plane" size="1 1 1"/>
        <body pos="0.1 0 0.2" euler="0.3 0.1 0.2"><joint type="slide" axis="1 1 0"/>
          <joint axis="0 1 0" pos="0.2 0 0.3"/>{BODY}<geom size="0.1"/>
          <body pos="0 0.3 0"><joint axis="1 0 1"/><geom size="0.2" mass="3"/></body></body>
        </worldbody>
        <worldbody><body name="late"><joint name="body_1" type="ball"/>{BODY}</body></worldbody></mujoco>""",
    "free base with frames, fixed parts": f"""<mujoco><worldbody><body name="post"><geom size="1"/></body>
        <body name="base" pos="1 2 3"><freejoint name="f"/>{BODY}<frame pos="0.1 0 0" euler="10 20 30">
        <body name="tip" pos="0 0 0.1"><frame><geom size="0.2"/></frame></body></frame><body name="bare"/>
        <frame euler="0 0 12"><body name="arm" pos="0.3 0 0"><joint name="a"/><geom size="0.1"/></body></frame></body>
        </worldbody></mujoco>""",
    "settings that change inertias": f"""<mujoco><compiler boundmass="5" boundinertia="5" balanceinertia="true"
        settotalmass="3" inertiafromgeom="true"/><compiler fusestatic="true"/><worldbody><body name="a">
        <joint name="j" axis="0 1 0"/>{BODY}<geom size="0.1"/><body name="lump" pos="0 0 1">{BODY}
        <geom size="0.1"/></body></body></worldbody></mujoco>""",
}


def mujoco_efforts(
    text: str, states: tuple[np.ndarray, ...], folder: Path
) -> np.ndarray:
    import mujoco

    (folder / "simulated.xml").write_text(text)
    model = mujoco.MjModel.from_xml_path(str(folder / "simulated.xml"))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    efforts = []
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(*states, strict=True):
        mujoco.mj_inverse(model, data)
        efforts.append(data.qfrc_inverse.copy())
    return np.array(efforts)


def check_mjcf(file: Path, folder: Path) -> WrittenRobot:
    mechanism = ec.load(file, snap_tolerance=0)
    values = random_parameters(mechanism)
    (written,) = identified_robot(mechanism, values, open_robot(file))
    again = reread(written, ReadingOptions(snap_tolerance=0), folder)
    assert geometry(again) == geometry(mechanism)
    assert_near(standard(again), values, 1e-11)
    states = random_states(mechanism, 3)
    found = mujoco_efforts(written.text, states, folder)
    assert_near(found, float_regressor(mechanism, *states) @ values, 1e-9)
    return written


@pytest.mark.filterwarnings("ignore:compiler attribute")
@pytest.mark.parametrize("name", MJCFS)
def test_written_mjcf_in_mujoco_and_read_again(name: str, tmp_path: Path) -> None:
    (tmp_path / "in.xml").write_text(MJCFS[name])
    check_mjcf(tmp_path / "in.xml", tmp_path)


def test_written_example_is_the_example_elsewhere(tmp_path: Path) -> None:
    file = EXAMPLES / "two_link.xml"
    written = check_mjcf(file, tmp_path)
    kept = [line for line in file.read_text().splitlines() if "<inertial" not in line]
    assert [line for line in written.text.splitlines() if line in kept] == kept


def test_includes_are_put_in_place_with_their_comments(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "arm.xml").write_text(
        f"""<mujocoinclude><!-- an arm --><body name="a"><joint name="j"/>{BODY}
        <include file="hand.xml"/></body></mujocoinclude>"""
    )
    (tmp_path / "parts" / "hand.xml").write_text(
        f'<mujoco><body name="b" pos="0 1 0"><joint name="k" axis="1 0 0"/>{BODY}</body></mujoco>'
    )
    (tmp_path / "in.xml").write_text(
        '<mujoco><worldbody><include file="parts/arm.xml"/></worldbody></mujoco>'
    )
    written = check_mjcf(tmp_path / "in.xml", tmp_path)
    assert "<!-- an arm -->" in written.text
    assert "include" not in written.text


def test_missing_includes_stay_where_they_are(tmp_path: Path) -> None:
    body = (
        f'<body name="a"><joint name="j"/>{BODY}<geom type="mesh" mesh="gone"/></body>'
    )
    text = f'<mujoco><include file="assets.xml"/><worldbody>{body}</worldbody></mujoco>'
    (tmp_path / "in.xml").write_text(text)
    mechanism = ec.load(tmp_path / "in.xml", snap_tolerance=0)
    values = random_parameters(mechanism)
    (written,) = identified_robot(mechanism, values, open_robot(tmp_path / "in.xml"))
    assert '<include file="assets.xml"/>' in written.text
    again = reread(written, ReadingOptions(snap_tolerance=0), tmp_path)
    assert_near(standard(again), values, 1e-11)


def test_bodies_that_are_multiplied_are_written_as_a_description(
    tmp_path: Path,
) -> None:
    (tmp_path / "in.xml").write_text(
        f"""<mujoco><worldbody><replicate count="3" offset="0 0.1 0.2">
        <body name="arm" pos="0.4 0 0"><joint name="j"/>{BODY}</body></replicate></worldbody></mujoco>"""
    )
    file = open_robot(tmp_path / "in.xml")
    mechanism = file.mechanism()
    values = standard(mechanism)
    written, urdf = identified_robot(mechanism, values, file)
    assert (written.name, urdf.name) == ("identified.yaml", "identified.urdf")
    assert_near(
        standard(reread(written, ReadingOptions(snap_tolerance=0), tmp_path)),
        values,
        1e-11,
    )


def test_drives_of_mjcf_become_attributes_of_joints(tmp_path: Path) -> None:
    import mujoco

    (tmp_path / "in.xml").write_text(
        f"""<mujoco><default><joint damping="9" stiffness="4"/></default><worldbody><body name="a">
        <joint name="j" axis="0 1 0"/>{BODY}
        <body name="b" pos="0.3 0 0"><joint name="k" axis="0 1 0" armature="0.5"/>{BODY}</body></body>
        </worldbody></mujoco>"""
    )
    (tmp_path / "in.yaml").write_text(
        """{echelon: 1, name: driven, robot: {file: in.xml}, actuators: {m: -10*k}, effects: [
        {type: viscous, at: all}, {type: coulomb, at: m}, {type: rotor_inertia, at: m}, {type: spring, at: j}]}"""
    )
    mechanism = ec.load(tmp_path / "in.yaml")
    values = dict(zip(mechanism.parameters, random_parameters(mechanism), strict=True))
    (written,) = identified_robot(
        mechanism, list(values.values()), open_robot(tmp_path / "in.xml")
    )
    model = mujoco.MjModel.from_xml_string(written.text)
    fv = [values[name] for name in values if name.startswith("Fv")]
    fc, ia = (
        next(values[name] for name in values if name.startswith(start))
        for start in ("Fc", "Ia")
    )
    by_actuator = dict(
        zip([e.actions[0].at for e in mechanism.effects[:2]], fv, strict=True)
    )
    np.testing.assert_allclose(
        np.ravel(model.dof_damping),
        [by_actuator["j"], 100 * by_actuator["m"]],
        rtol=1e-15,
    )
    np.testing.assert_allclose(model.dof_frictionloss, [0, 10 * fc], rtol=1e-15)
    np.testing.assert_allclose(model.dof_armature, [0, 100 * ia], rtol=1e-15)
    np.testing.assert_allclose(
        np.ravel(model.jnt_stiffness), [values["Ks1"], 4], rtol=1e-15
    )
    np.testing.assert_allclose(
        model.qpos_spring, [-values["Ps1"] / values["Ks1"], 0], rtol=1e-14
    )
    assert (
        "stiffness stays as in the input, since the identified model has no such effect: 'k'"
        in written.notes
    )


def test_held_joints_keep_next_to_no_mass(tmp_path: Path) -> None:
    import mujoco

    (tmp_path / "in.xml").write_text(
        f"""<mujoco><worldbody><body name="a"><joint name="j"/>{BODY}<body name="b" pos="0 1 0"><joint name="k"/>{BODY}
        </body></body></worldbody><equality><joint joint1="k" polycoef="0.3 0 0 0 0"/></equality></mujoco>"""
    )
    mechanism = ec.load(tmp_path / "in.xml", snap_tolerance=0)
    assert len(mechanism.bodies) == 1
    values = random_parameters(mechanism)
    (written,) = identified_robot(mechanism, values, open_robot(tmp_path / "in.xml"))
    assert_near(standard(reread(written, directory=tmp_path)), values, 1e-11)
    assert mujoco.MjModel.from_xml_string(
        written.text
    ).body_mass.sum() == pytest.approx(values[9], rel=1e-12)


@pytest.mark.filterwarnings("ignore:compiler attribute")
@pytest.mark.parametrize("setting", ["", 'settotalmass="9"'])
def test_bodies_with_the_values_of_their_file_stay_unless_settings_change_them(
    setting: str, tmp_path: Path
) -> None:
    first = f"""<body name="a"><joint name="j" armature=".30" damping="0"/>{BODY}
        <body name="lid" pos="0 0 .1"><geom size=".1"/></body>"""
    second = '<body name="b" pos="0 1 0"><joint name="k" armature=".20"/><geom size=".10" mass="2.0"/></body>'
    (tmp_path / "in.xml").write_text(
        f"<mujoco><compiler {setting}/><worldbody>{first}{second}</body></worldbody></mujoco>"
    )
    mechanism = ec.load(tmp_path / "in.xml", snap_tolerance=0)
    values = standard(mechanism)
    values[10:] *= 1.5
    (written,) = identified_robot(mechanism, values, open_robot(tmp_path / "in.xml"))
    assert (first in written.text) == (not setting)
    assert second not in written.text
    again = reread(written, ReadingOptions(snap_tolerance=0), tmp_path)
    assert_near(standard(again), values, 1e-11)
