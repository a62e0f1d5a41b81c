"""Two robots compared, against Pinocchio, null spaces of B, and files that say one thing in two ways."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

import echelon as ec
from echelon.comparison.result import comparison_schema
from echelon.shared.conventions import PER_BODY
from support.command_line import run
from support.paths import ROOT
from support.random_urdf import random_links, urdf
from support.robot_files import robot_file
from support.selection import one_in

ARM = (ROOT / "examples" / "so101.urdf").read_text(encoding="utf-8")
LOOP = (ROOT / "examples" / "loops" / "four_bar.yaml").read_text(encoding="utf-8")
pytestmark = pytest.mark.filterwarnings("ignore::echelon.DoubtWarning")
SEEDS = [
    *range(6),
    *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(6, 36)),
]
BODY = "inertial: {mass: %s, com: [0.1, 0.02, 0], inertia: {xx: 0.011, yy: 0.012, zz: 0.013}}"


def four_bar(mass: float, coupler: float = 0.35) -> str:
    text = LOOP.replace("value: 0.35", f"value: {coupler}")
    text = text.replace("crank, joint: revolute", f"crank, joint: revolute, {BODY % 1}")
    text = text.replace("revolute, a: l2", f"revolute, a: l2, {BODY % mass}")
    return text.replace("base, a: l1", f"base, a: l1, {BODY % 3}")


def edited(pattern: str, new: str, text: str = ARM) -> str:
    found, count = re.subn(pattern, new, text, count=1, flags=re.DOTALL)
    assert count == 1
    return found


def with_standard(robot: ec.Mechanism, standard: np.ndarray) -> ec.Mechanism:
    """The robot with other inertial values."""
    bodies = list(robot.bodies)
    for k, start in robot.first_column.items():
        values = tuple(standard[start : start + PER_BODY].tolist())
        bodies[k] = replace(bodies[k], inertial=values)
    return replace(robot, bodies=tuple(bodies))


# -- inertial values ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_what_lies_in_the_null_space_is_invisible(seed: int) -> None:
    """B Δζ = 0: no output shows any of it, however large it is."""
    rng = np.random.default_rng(seed)
    robot = ec.load(urdf(random_links(rng, 1 + seed % 4)))
    base = ec.base_parameters(robot)
    b = base.B_float()
    standard = base.standard_values()
    free = [k for k, name in enumerate(base.parameters) if name not in base.pivots]
    change = np.zeros(len(standard))
    change[free] = rng.uniform(-1, 1, len(free))
    change[list(base.matrix.pivots)] = -b[:, free] @ change[free]
    found = ec.compare(robot, with_standard(robot, standard + change))
    assert found.verdict is ec.Equality.EQUAL
    assert not found.base
    assert {p.name for p in found.invisible} == {
        name for name, x in zip(base.parameters, change, strict=True) if abs(x) > 1e-7
    }
    assert max(o.total.attained for o in found.outputs) < 1e-8


@pytest.mark.parametrize("seed", SEEDS)
def test_no_state_exceeds_the_bounds_and_examples_are_attained(seed: int) -> None:
    pin = pytest.importorskip("pinocchio")
    rng = np.random.default_rng(seed)
    links = random_links(rng, 1 + seed % 5)
    changed = int(rng.integers(len(links)))
    others = [
        link.heavier(0.1) if k == changed else link for k, link in enumerate(links)
    ]
    texts = urdf(links), urdf(others)
    found = ec.compare(*texts)
    models = [pin.buildModelFromXML(text) for text in texts]
    order = [
        models[0].joints[models[0].getJointId(name)].idx_v
        for name in found.coordinates["q"]
    ]

    def apart(state: Mapping[str, Any]) -> np.ndarray:
        """The first robot's torques minus the second's."""
        vectors = np.zeros((3, models[0].nv))
        for row, name in enumerate(("q", "qd", "qdd")):
            vectors[row, order] = state[name]
        one, two = (pin.rnea(model, model.createData(), *vectors) for model in models)
        return np.abs(one - two)[order]

    for place, output in enumerate(found.outputs):
        total, parts = output.total, output.parts
        np.testing.assert_allclose(apart(total.state)[place], total.attained, atol=1e-9)
        still = {**parts["gravity"].state, "qd": 0.0, "qdd": 0.0}
        np.testing.assert_allclose(
            apart(still)[place], parts["gravity"].attained, atol=1e-9
        )
        assert total.bound is not None
        assert total.attained <= total.bound
    bounds = np.array([output.total.bound for output in found.outputs])
    limits = {
        kind: np.array([found.limits[f"{kind}[{n}]"] for n in found.coordinates["q"]])
        for kind in ("q", "qd", "qdd")
    }
    for _ in range(500):
        state = {kind: rng.uniform(*ends.T) for kind, ends in limits.items()}
        assert (apart(state) <= bounds + 1e-9).all()
        corner = {kind: rng.choice(ends.T) for kind, ends in limits.items()}
        assert (apart(corner) <= bounds + 1e-9).all()


def test_rounded_decimals_are_no_difference() -> None:
    rng = np.random.default_rng(5)
    text = urdf(random_links(rng, 3))

    def rounded(match: re.Match[str]) -> str:
        return f"{float(match[0]):.5f}"

    inertial = re.compile(r"<inertial>.*?</inertial>")
    short = inertial.sub(lambda m: re.sub(r"-?\d+\.\d+(e-\d+)?", rounded, m[0]), text)
    assert short != text
    found = ec.compare(text, short)
    assert found
    assert 0 < max(o.total.attained for o in found.outputs) < 1e-2
    assert not ec.compare(text, short, tolerance=1e-9)
    assert found.rounded > 0
    assert not found.cancelled
    assert "equal in all outputs, with differences below the files' last" in str(found)


@pytest.mark.parametrize(("units", "code"), [(0, 0), (1, 0), (2000, 1)])
def test_differences_below_the_last_decimals_are_called_so(
    units: int, code: int, tmp_path: Path
) -> None:
    """Centres of mass with seven decimals, each up by some units of the last one."""

    def moved(match: re.Match[str]) -> str:
        shifted = (f"{float(x) + 1e-7 * units:.10f}" for x in match[2].split())
        return match[1] + " ".join(shifted)

    other = re.sub(r'(<inertial>\s*<origin xyz=")([^"]+)', moved, ARM)
    found = ec.compare(ARM, other)
    said = "below the files' last decimals"
    assert (said in found.heading()[0]) == (units == 1)
    assert bool(found.rounded) == (units > 0)
    assert not found.cancelled
    (tmp_path / "a.urdf").write_text(ARM)
    (tmp_path / "b.urdf").write_text(other)
    ended = run("compare", "a.urdf", "b.urdf", cwd=tmp_path)
    assert ended.returncode == code, ended.stderr
    assert (said in ended.stdout) == (units > 0)


def test_mass_moved_between_links_shows_where_it_matters() -> None:
    """The mass of a link counts to its parent's: what a tip loses and its carrier gets at the joint is invisible."""
    robot = ec.load(ARM)
    found = ec.compare(robot, edited('mass value="0.104"', 'mass value="0.2"'))
    assert found.verdict is ec.Equality.DIFFERENT
    assert {o.name for o in found.outputs if o.total.attained > o.tolerance} == {
        "shoulder_pan",
        "shoulder_lift",
        "elbow_flex",
    }
    assert all(difference.effect > 0 for difference in found.base)


def test_friction_takes_one_line_so_that_inertias_show() -> None:
    rubbing = ARM.replace("<limit", '<dynamics damping="9" friction="9"/><limit')
    heavier = edited('mass value="0.104"', 'mass value="0.2"', rubbing)
    found = ec.compare(ARM, heavier, limits={"velocity": 3})
    effects = [one for one in found.base if not one.body]
    assert len(effects) == 12
    assert found.base[0] in effects  # friction of 9 N·m shows more than 0.1 kg
    lines = [line for line in found.heading() if line.startswith("  visible:")]
    assert "and 11 more of friction, springs or rotors" in lines[0]
    assert len(lines) > 2
    assert not [line for line in lines[1:] if re.search("F[vc]", line)]


# -- one robot in two ways ---------------------------------------------------------------------------------------------


def test_formats_say_one_thing(tmp_path: Path) -> None:
    robot = ec.load(ARM)
    assert ec.compare(robot, robot)
    pin = pytest.importorskip("pinocchio")
    mujoco = pytest.importorskip("mujoco")
    assert ec.compare(ARM, pin.buildModelFromXML(ARM))
    assert ec.compare(ARM, mujoco.MjSpec.from_string(ARM))
    ec.save_base(ec.base_parameters(robot), tmp_path / "set.json")
    assert ec.compare(tmp_path / "set.json", ARM)


def test_other_names_are_matched_by_axes() -> None:
    rng = np.random.default_rng(2)
    links = random_links(rng, 4)
    names = {f"j{k}": f"m{5 - k}" for k in range(1, 5)}
    found = ec.compare(urdf(links), urdf(links, names))
    assert found
    assert dict(found.matched) == names
    assert "matched by axes: j1 = m4" in str(found)


def test_a_base_placed_otherwise_moves_no_joint() -> None:
    start = '<joint name="shoulder_pan" type="revolute">'
    frame = (
        '<link name="root"/><joint name="stand" type="fixed"><parent link="root"/><child link="base"/>'
        '<origin xyz="0.3 -0.2 0.5" rpy="0 0 0.7"/></joint>'
    )
    found = ec.compare(ARM, ARM.replace(start, frame + start))
    assert found
    np.testing.assert_allclose(found.moved[1], 0.7, atol=1e-6)
    tilted = found = ec.compare(
        ARM, ARM.replace(start, frame.replace("0 0 0.7", "0.7 0 0") + start)
    )
    assert [d.kind for d in tilted.geometry] == ["gravity"]
    np.testing.assert_allclose(
        tilted.geometry[0].size, 2 * 9.81 * np.sin(0.35), rtol=1e-6
    )
    assert not tilted


# -- geometry ----------------------------------------------------------------------------------------------------------

LINK = r'(<joint name="{}" type="revolute">.*?<origin xyz=")([^"]*)(" rpy=")([^"]*)'


def test_a_longer_link_shows_once() -> None:
    x, y, z = re.search(LINK.format("elbow_flex"), ARM, re.DOTALL)[2].split()  # type: ignore[index]
    moved = f"{float(x) + 0.01:.6f} {y} {z}"
    found = ec.compare(
        ARM, edited(LINK.format("elbow_flex"), rf"\g<1>{moved}\g<3>\g<4>")
    )
    assert [(d.joint, d.kind) for d in found.geometry] == [
        ("elbow_flex", "axis position")
    ]
    np.testing.assert_allclose(found.geometry[0].size, 0.01, rtol=1e-3)
    assert not found


@pytest.mark.parametrize("seed", one_in(4, range(4)))
def test_zeros_and_directions_are_named(seed: int) -> None:
    """Another zero of a joint is a turn behind it, and another direction a turn of the other sign."""
    links = random_links(np.random.default_rng(seed), 3)
    chain = [
        replace(link, parent=f"l{k}" if k else "base", kind="revolute", rpy="0 0 0")
        for k, link in enumerate(links)
    ]
    axes = ("0 0 1", "0 1 0", "1 0 0")
    chain = [replace(link, axis=axis) for link, axis in zip(chain, axes, strict=True)]
    other = [replace(chain[0], rpy="0 0 0.4"), *chain[1:]]
    turned = ec.compare(urdf(chain), urdf(other), limits={"velocity": 1})
    assert turned, "a turn about a vertical first axis is another base frame"
    other = [chain[0], replace(chain[1], rpy="0 0.4 0"), chain[2]]
    (zero,) = ec.compare(urdf(chain), urdf(other)).geometry
    assert (zero.joint, zero.kind) == ("j2", "zero")
    np.testing.assert_allclose(zero.size, 0.4, rtol=1e-6)
    other = [chain[0], replace(chain[1], axis="0 -1 0"), chain[2]]
    (direction,) = ec.compare(urdf(chain), urdf(other)).geometry
    assert (direction.joint, direction.kind) == ("j2", "positive direction")


def test_every_explanation_of_a_wrist_is_named() -> None:
    """With crossing axes a reversed joint is also half a turn of the one before; inertias tell which it is."""
    links = random_links(np.random.default_rng(3), 3)
    chain = [
        replace(link, parent=f"l{k}" if k else "base", kind="revolute", rpy="0 0 0")
        for k, link in enumerate(links)
    ]
    axes = ("1 0 0", "0 0 1", "0 1 0")
    chain = [
        replace(link, axis=axis, xyz=np.array([0, 0, 0.3]))
        for link, axis in zip(chain, axes, strict=True)
    ]
    reversed_one = [*chain[:2], replace(chain[2], axis="0 -1 0")]
    turned = [chain[0], replace(chain[1], rpy=f"0 0 {np.pi}"), chain[2]]
    zero, direction = "j2: zero differs", "j3: positive direction differs"
    for other, right, wrong in (
        (reversed_one, direction, zero),
        (turned, zero, direction),
    ):
        found = ec.compare(urdf(chain), urdf(other))
        assert str(found.geometry[0]).startswith(right)
        assert any(wrong in note for note in found.notes)
        assert not found.base


def test_other_joints_are_refused() -> None:
    with pytest.raises(ec.InputError, match="only so101 has gripper"):
        ec.compare(
            ARM, edited('name="gripper" type="revolute"', 'name="jaw" type="fixed"')
        )
    with pytest.raises(
        ec.InputError, match="one is a rotation, the other a translation"
    ):
        ec.compare(
            ARM, edited('"gripper" type="revolute"', '"gripper" type="prismatic"')
        )
    held = ec.compare(
        ARM,
        edited('name="gripper" type="revolute"', 'name="jaw" type="fixed"'),
        locked={"gripper": 0},
    )
    assert held
    with pytest.raises(ec.InputError, match="neither robot has a joint 'griper'"):
        ec.compare(ARM, ARM, locked={"griper": 0})
    with pytest.raises(ec.InputError, match="states no inertial values"):
        ec.compare(ROOT / "examples/rx90.yaml", ROOT / "examples/rx90.yaml")


# -- loops, effects, floating bases ------------------------------------------------------------------------------------


def test_loops_are_compared_at_closed_states() -> None:
    assert ec.compare(four_bar(2), four_bar(2))
    heavier = ec.compare(four_bar(2), four_bar(2.5))
    assert heavier.verdict is ec.Equality.DIFFERENT
    (crank,) = heavier.outputs
    assert crank.total.bound is None
    assert {"YY2"} <= {p.name for p in heavier.invisible} <= {"XX2", "XY2", "YY2"}
    longer = ec.compare(four_bar(2), four_bar(2, 0.36))
    assert {d.kind for d in longer.geometry} == {"motion"}


def test_stated_friction_and_rotors_count() -> None:
    axis = r'(<axis xyz="0 0 1"/>)'
    rubbing = edited(axis, r'\g<1><dynamics damping="0.3" friction="0.1"/>')
    found = ec.compare(ARM, rubbing, limits={"velocity": 2})
    assert {difference.name for difference in found.base} == {"Fv1", "Fc1"}
    (pan,) = (output for output in found.outputs if output.total.attained > 1e-6)
    np.testing.assert_allclose(pan.parts["effects"].attained, 0.7, rtol=1e-3)
    assert pan.total.bound is not None
    assert 0.7 <= pan.total.bound < 0.71


@pytest.mark.parametrize(
    ("ends", "expected"),
    [
        ([2, "none"], (2.0, 2 + 2 * np.pi)),
        (["none", -2], (-2 - 2 * np.pi, -2.0)),
        ("none", (-np.pi, np.pi)),
    ],
)
def test_a_whole_turn_is_compared_where_limits_are_open(
    ends: object, expected: tuple[float, float]
) -> None:
    """A pendulum that is twice as heavy differs most where its arm is level, by m g x = 1 N m."""
    arm = "{mass: %s, com: [0, -0.1, 0], inertia: {xx: 0.03, yy: 0.03, zz: 0.03}}"
    text = "echelon: 1\nname: pendulum\ngravity: [0, -10, 0]\nmodified_dh:\n"
    text += f"  - {{name: j1, joint: revolute, inertial: {arm}}}\n"
    limits = {"position": {"j1": ends}, "velocity": 1, "acceleration": 0.001}
    found = ec.compare(text % 1, text % 2, limits=limits)
    np.testing.assert_allclose(found.limits["q[j1]"], expected)
    assert any("over one turn" in note for note in found.notes)
    (output,) = found.outputs
    np.testing.assert_allclose(output.parts["gravity"].attained, 1.0, rtol=1e-3)


def test_a_floating_base_has_a_wrench() -> None:
    heavy = edited('mass value="0.012"', 'mass value="0.112"')
    found = ec.compare(ec.load(ARM, floating=True), ec.load(heavy, floating=True))
    force = next(o for o in found.outputs if o.name == "base.tz")
    assert force.unit == "N"
    np.testing.assert_allclose(force.parts["gravity"].attained, 0.981, rtol=1e-3)


FLOATING_URDF = """<robot name="urdf">
  <link name="trunk"><inertial><mass value="3"/>
    <inertia ixx="0.03" iyy="0.04" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="arm"><inertial><origin xyz="0.1 0 0.02"/><mass value="2"/>
    <inertia ixx="0.003" iyy="0.004" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="continuous"><parent link="trunk"/><child link="arm"/>
    <origin xyz="0.2 0 0.1"/><axis xyz="0 1 0"/></joint>
</robot>"""
FLOATING_MJCF = """<mujoco model="mjcf"><worldbody><body name="trunk"><freejoint name="root"/>
  <inertial pos="0 0 0" mass="3" diaginertia="0.03 0.04 0.05"/>
  <body name="arm" pos="0.2 0 0.1"><joint name="shoulder" axis="0 1 0"/>
    <inertial pos="0.1 0 0.02" mass="2" diaginertia="0.003 0.004 0.005"/></body>
</body></worldbody></mujoco>"""


@pytest.mark.parametrize("heavier", [False, True])
@pytest.mark.parametrize("mjcf_first", [False, True])
def test_a_base_floats_alike_in_both_formats(mjcf_first: bool, heavier: bool) -> None:
    text = FLOATING_MJCF.replace('mass="2"', 'mass="3"') if heavier else FLOATING_MJCF
    robots = ec.load(FLOATING_URDF, floating=True), ec.load(text)
    first, second = reversed(robots) if mjcf_first else robots
    limits = {"velocity": 2, "acceleration": 3}
    found = ec.compare(first, second, limits=limits)
    assert found.verdict == ("different" if heavier else "equal")
    one, two = (["base", "root"][robot is robots[1]] for robot in (first, second))
    assert (f"{one}.tx", f"{two}.tx") in found.matched


@pytest.mark.slow
@pytest.mark.parametrize(
    ("first", "second", "equal"),
    [
        ("ur_description/urdf/ur5_robot", "ur_description/urdf/ur5_joint_limited_robot", True),
        ("ur_description/urdf/ur5_robot", "ur_description/urdf/ur5_gripper", True),
        ("panda_description/urdf/panda", "panda_description/urdf/panda_collision", True),
        ("ur_description/urdf/ur5_robot", "ur_description/urdf/ur10_robot", False),
    ],
)  # fmt: skip
def test_variants_of_published_robots(first: str, second: str, equal: bool) -> None:
    folder = robot_file("panda").parents[2]
    found = ec.compare(folder / f"{first}.urdf", folder / f"{second}.urdf")
    assert bool(found) is equal
    assert bool(found.geometry) is not equal


# -- the command -------------------------------------------------------------------------------------------------------


def test_exit_codes_and_json(tmp_path: Path) -> None:
    (tmp_path / "a.urdf").write_text(ARM)
    (tmp_path / "b.urdf").write_text(edited('mass value="0.104"', 'mass value="0.2"'))
    assert run("compare", "a.urdf", "a.urdf", cwd=tmp_path).returncode == 0
    found = run("compare", "a.urdf", "b.urdf", "--json", cwd=tmp_path)
    assert found.returncode == 1
    record = json.loads(found.stdout)
    jsonschema.Draft202012Validator(comparison_schema()).validate(record)
    assert record["verdict"] == "different"
    wide = ("--tolerance", "50", "--velocity", "0.1", "--acceleration", "0.1")
    assert run("compare", "a.urdf", "b.urdf", *wide, cwd=tmp_path).returncode == 0
    wrong = run("compare", "a.urdf", "b.urdf", "--lock", "gripper", cwd=tmp_path)
    assert wrong.returncode == 2
    assert "NAME=POSITION" in wrong.stderr


def test_bounds_leave_open_what_no_state_shows() -> None:
    """Between the largest difference that was met and the bound nothing is known."""
    heavy = edited('mass value="0.104"', 'mass value="0.2"')
    worst = max(ec.compare(ARM, heavy).outputs, key=lambda o: o.total.attained).total
    assert worst.bound is not None
    between = (worst.attained + worst.bound) / 2
    found = ec.compare(ARM, heavy, tolerance=between)
    assert found.verdict is ec.Equality.UNDECIDED
