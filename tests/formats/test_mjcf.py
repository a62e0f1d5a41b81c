"""MJCF: exactness of numbers, snapping, which elements count and how, and every refusal."""

from __future__ import annotations

import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from echelon.base.structure import find_structure
from echelon.formats.builder import build_mechanism
from echelon.formats.literal import LiteralMotion, LiteralPlacement, rotation_matrix
from echelon.formats.mjcf.mjcf_model import checked_mjcf
from echelon.formats.mjcf.mjcf_numbers import placements, quaternion_matrix
from echelon.formats.mjcf.mjcf_reader import read_mjcf
from echelon.formats.snapping import ReadingOptions
from echelon.shared.errors import InputError, MissingExtraError
from support.mjcf_models import INERTIA, mechanism_of, model, read
from support.paths import EXAMPLES

# -- numbers -----------------------------------------------------------------------------------------------------------


def test_numbers_stay_exact() -> None:
    text = model(
        f"""<body name="a" pos="0.333 -1e-7 0.1"><joint name="a" pos="0.0825 0 0.7"/>{INERTIA}
        <frame pos="0.1 0 0.1"><body name="b" pos="0.2 0 0.2"><joint name="b" type="slide"/>{INERTIA}</body></frame>
        </body>""",
        '<option gravity="0 0 -9.81"/>',
        '<equality><joint joint1="b" joint2="a" polycoef="0.001 0.0127 0 0 0"/></equality>',
    )
    tree = read(text)
    body, anchor = (step for step in tree.links[1].steps[:2])
    assert isinstance(body, LiteralPlacement)
    assert isinstance(anchor, LiteralPlacement)
    assert body.xyz == (Fraction(333, 1000), Fraction(-1, 10**7), Fraction(1, 10))
    assert anchor.xyz == (Fraction(825, 10000), 0, Fraction(7, 10))
    framed = tree.links[2].steps[0]
    assert isinstance(framed, LiteralPlacement)
    assert framed.xyz == (Fraction(3, 10), 0, Fraction(3, 10))
    assert tree.gravity == (0, 0, Fraction(-981, 100))
    assert tree.couplings[0].terms["a"].ratio == Fraction(127, 10000)
    assert tree.couplings[0].offset == Fraction(1, 1000)


def rpy_of(quaternion: str) -> list[tuple[float, ...]]:
    parts = placements("body", (0, 0, 0), [float(v) for v in quaternion.split()])
    return [tuple(float(v) for v in part.rpy) for part in parts]


def test_rounded_quaternions_become_right_angles() -> None:
    half = np.pi / 2
    assert rpy_of("0.707107 0.707107 0 0") == [(half, 0, 0)]
    assert rpy_of("0.5 0.5 0.5 0.5") == [(half, 0, half)]
    first, second = rpy_of("0.7071 0 0.7072 0")
    assert first == (0, half, 0)
    assert max(abs(v) for v in second) < 2e-4


@pytest.mark.parametrize(
    "quaternion",
    [
        "0.7071 0 0.7072 0",
        "0.7071 0 -0.7071 1e-5",
        "0.707 0.0004 0.707 -0.0004",
        "0.1 0.7 0.1 0.7",
        "0.5 -0.5 -0.5 0.5",
    ],
)
def test_rounded_gimbal_lock_is_read_as_exact(quaternion: str) -> None:
    """Roll and yaw of such a quaternion are arbitrary; the mechanism must still get a rotation without symbols."""
    text = model(
        f"""<body name="a" quat="{quaternion}"><joint name="a"/>{INERTIA}
        <body name="b" pos="0.3 0 0"><joint name="b" axis="1 0 0"/>{INERTIA}</body></body>"""
    )
    mechanism = build_mechanism(read(text), ReadingOptions()).mechanism
    assert not [name for name in mechanism.symbols if not name.startswith("p")]


def test_placements_reproduce_the_rotation() -> None:
    rng = np.random.default_rng(5)
    quaternions = list(rng.normal(size=(50, 4)))
    for size in (
        1e-9,
        1e-6,
        1e-3,
        4e-3,
        0.02,
    ):  # around both gimbal locks, and around right angles
        for q in (
            [1, 0, 1, 0],
            [1, 0, -1, 0],
            [1, 1, 1, 1],
            [1, 1, -1, 1],
            [1, 1, 0, 0],
            [0, 1, 0, 1],
        ):
            quaternions += list(np.array(q) + size * rng.normal(size=(5, 4)))
    for quaternion in quaternions:
        matrix = np.eye(3)
        for part in placements("body", (0, 0, 0), quaternion):
            matrix = matrix @ rotation_matrix(*(float(v) for v in part.rpy))
        np.testing.assert_allclose(
            matrix, quaternion_matrix(quaternion), rtol=0, atol=1e-12
        )


def test_a_reference_is_along_the_axis_exactly() -> None:
    """A right angle of ref must not bring symbols, nor change the direction of an odd axis."""
    text = model(
        f"""<body name="a"><joint name="a" axis="1 0 0" ref="90"/>{INERTIA}
        <body name="b" pos="0 0.2 0"><joint name="b" axis="0.6 0.8 0" ref="45"/>{INERTIA}</body></body>"""
    )
    mechanism = build_mechanism(read(text), ReadingOptions()).mechanism
    assert len([name for name in mechanism.symbols if not name.startswith("p")]) == 1


# -- structure ---------------------------------------------------------------------------------------------------------


def test_systematic_names_and_several_joints() -> None:
    text = model(
        f"""<body><joint/><joint type="slide" pos="1 2 3"/>{INERTIA}<body name="body_3"/>
        <body>{INERTIA}</body></body>"""
    )
    tree = read(text)
    assert [link.name for link in tree.links] == [
        "world",
        "body_1",
        "body_3",
        "body_3_",
    ]
    assert [link.parent for link in tree.links] == [-1, 0, 1, 1]
    assert [(link.joint, link.kind) for link in tree.links[1:]] == [
        ("joint_0+joint_1", "hinge+slide"),
        ("body_3", "fixed"),
        ("body_3_", "fixed"),
    ]
    assert [s.name for s in tree.links[1].steps if isinstance(s, LiteralMotion)] == [
        "joint_0",
        "joint_1",
    ]
    assert (
        len(tree.links[1].steps) == 3
    )  # where a slide is anchored makes no difference


def test_static_bodies_are_not_fused() -> None:
    text = model(
        f'<body name="a"><joint/>{INERTIA}<body name="b" pos="0 0 1">{INERTIA}</body></body>',
        '<compiler fusestatic="true"/>',
    )
    assert [link.name for link in read(text).links] == ["world", "a", "b"]


def test_free_bodies_keep_their_frames() -> None:
    text = model(
        f'<body name="a" pos="1 2 3"><freejoint name="f" align="true"/>{INERTIA}</body>'
    )
    tree = read(text)
    assert tree.links[1].steps == (LiteralMotion("joint 'f'", "f", "floating"),)
    assert tree.links[1].inertial is not None
    assert tree.links[1].inertial[6:] == pytest.approx(
        (1.3 * 0.05, -1.3 * 0.02, 1.3 * 0.11, 1.3)
    )
    assert any("alignment" in note for note in tree.notes)


def test_bodies_without_inertia_are_silent_even_if_they_move() -> None:
    text = model(
        """<body name="a"><joint name="a"/><body name="b"><joint name="b"/><inertial pos="0 0 0.5" mass="2"
        diaginertia="0 0 0"/></body><body name="c"><geom size="0.1" mass="0"/></body></body>"""
    )
    tree = read(text)
    assert [link.inertial is None for link in tree.links] == [True, True, False, True]
    assert tree.links[2].inertial == (0.5, 0, 0, 0.5, 0, 0, 0, 0, 1, 2)


def test_inertia_of_geoms_counts_where_the_file_has_no_other() -> None:
    tree = read(
        model('<body name="a"><joint/><geom size="0.1" mass="5" pos="1 0 0"/></body>')
    )
    assert tree.links[1].inertial is not None
    assert tree.links[1].inertial[6:] == pytest.approx((5, 0, 0, 5))


def test_effects_that_are_not_rigid_body_dynamics_are_noted() -> None:
    text = model(
        f'<body name="a"><joint name="a" armature="0.1" damping="2"/>{INERTIA}</body>'
    )
    assert any("joint armature, joint damping" in note for note in read(text).notes)


def test_missing_meshes_and_textures_do_not_matter_where_inertia_is_stated() -> None:
    assets = (
        '<asset><texture name="t" type="2d" file="no.png"/><material name="m" texture="t"/>'
        '<mesh name="mesh" file="no.stl"/><hfield name="h" file="no.hf" size="1 1 1 1"/></asset>'
    )
    tail = (
        '<actuator><motor joint="a"/></actuator><sensor><jointpos joint="a"/></sensor>'
    )
    geom = '<geom type="mesh" mesh="mesh" material="m"/>'
    ground = '<geom type="hfield" hfield="h"/>'
    tree = read(
        model(
            f'{ground}<body name="a"><joint name="a"/>{INERTIA}{geom}</body>',
            assets,
            tail,
        )
    )
    assert tree.links[1].inertial is not None
    assert tree.notes == ()


@pytest.mark.parametrize("present", [False, True])
def test_inertia_of_missing_meshes_is_unknown(tmp_path: Path, present: bool) -> None:
    (tmp_path / "meshes").mkdir()
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    faces = ["1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"]
    cube = [
        *(f"v {x} {y} {z}" for x, y, z in corners),
        *(f"f {face}" for face in faces),
    ]
    if present:
        (tmp_path / "meshes" / "cube.obj").write_text("\n".join(cube))
    assets = '<compiler meshdir="meshes"/><asset><mesh file="cube.obj"/><mesh file="gone.obj"/></asset>'
    text = model(
        """<body name="a"><joint/><geom type="mesh" mesh="cube" mass="3"/></body>
        <body name="b"><joint/><geom type="mesh" mesh="gone"/></body>
        <body name="c"><joint/><geom size="0.1"/></body>""",
        assets,
    )
    tree = read(text, tmp_path)
    assert [link.inertial is not None for link in tree.links[1:]] == [
        present,
        False,
        True,
    ]
    assert ("'a'" in tree.notes[0]) is not present
    assert "'b'" in tree.notes[0]
    assert (
        read(text).links[1].inertial is None
    )  # without a directory no mesh is looked for
    if present:
        assert tree.links[1].inertial is not None
        assert tree.links[1].inertial[6:] == pytest.approx((1.5, 1.5, 1.5, 3))


def test_includes(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "arm.xml").write_text(
        f'<mujocoinclude><body name="a"><joint/>{INERTIA}<include file="hand.xml"/></body></mujocoinclude>'
    )
    (tmp_path / "parts" / "hand.xml").write_text(
        '<mujocoinclude><body name="hand"/></mujocoinclude>'
    )
    text = model('<include file="parts/arm.xml"/>')
    assert [link.name for link in read(text, tmp_path).links] == ["world", "a", "hand"]
    with pytest.raises(
        InputError,
        match=r"robot.xml: include 'parts/arm.xml': the model has no directory",
    ):
        read(text)
    (tmp_path / "parts" / "hand.xml").unlink()
    with pytest.raises(
        InputError,
        match=r"parts.arm.xml: include 'hand.xml': no such file, and it is part of the bodies",
    ):
        read(text, tmp_path)
    (tmp_path / "parts" / "hand.xml").write_text(
        '<!DOCTYPE x [<!ENTITY a "b">]><mujocoinclude/>'
    )
    with pytest.raises(InputError, match=r"hand.xml: document type declarations"):
        read(text, tmp_path)


def test_missing_includes_are_left_out_unless_they_are_needed(tmp_path: Path) -> None:
    """Meshes and materials of a missing file do not matter beside stated inertials; its classes and bodies do."""
    body = """<body name="a"><joint/>{}<geom type="mesh" mesh="shell" material="steel"/></body>
    <body name="b"><joint/><geom type="mesh" mesh="shell"/></body>"""
    tree = read(model(body.format(INERTIA), '<include file="assets.xml"/>'), tmp_path)
    assert (
        tree.notes[0]
        == "included files are missing, read without what they define: 'assets.xml'"
    )
    assert (
        "inertias of body 'b' are unknown: they come from meshes that cannot be read"
        in tree.notes
    )
    assert [link.inertial is not None for link in tree.links] == [False, True, False]
    assert (
        read(model(body.format(INERTIA), '<include file="assets.xml"/>')).links
        == tree.links
    )
    for inner, head, problem in (
        (
            ARM.replace("<body", '<body childclass="heavy"', 1),
            "",
            "unknown default childclass; included files are",
        ),
        ("", "", "nothing moves; included files are missing: 'assets.xml'"),
        (
            ARM + '<include file="hand.xml"/>',
            "",
            "include 'hand.xml': no such file, and it is part of the bodies",
        ),
        (
            ARM,
            '<asset><model name="g" file="g.xml"/></asset>',
            "model 'g.xml': no such file",
        ),
    ):
        with pytest.raises(InputError, match=problem):
            read(model(inner, head + '<include file="assets.xml"/>'), tmp_path)
    with pytest.raises(InputError, match="mesh 'shell' not found"):
        read(model('<body><joint/><geom type="mesh" mesh="shell"/></body>'), tmp_path)


def test_inertias_from_geometry_are_noted() -> None:
    text = """<body name="a"><joint/>{}</body><body name="b"><joint/><geom size="0.1"/></body>
    <body name="c"><joint/></body><body name="d"><joint/><geom size="0.1" mass="0"/></body>"""
    (note,) = read(model(text.format(INERTIA))).notes
    assert (
        note
        == "inertias of body 'b' are computed from their geoms: the file does not state them"
    )
    (note,) = read(
        model(text.format(INERTIA), '<compiler inertiafromgeom="true"/>')
    ).notes
    assert "bodies 'a', 'b' are computed" in note


def test_attached_models(tmp_path: Path) -> None:
    (tmp_path / "gripper.xml").write_text(
        model(f'<body name="palm"><joint name="j"/>{INERTIA}</body>')
    )
    head = '<asset><model name="g" file="gripper.xml"/></asset>'
    text = model(
        f'<body name="a"><joint/>{INERTIA}<attach model="g" body="palm" prefix="left_"/></body>',
        head,
    )
    assert [link.joint for link in read(text, tmp_path).links] == [
        "",
        "joint_0",
        "left_j",
    ]


def test_example_file() -> None:
    tree = read_mjcf(
        checked_mjcf((EXAMPLES / "two_link.xml").read_bytes(), "two_link.xml", EXAMPLES)
    )
    assert tree.name == "two_link"
    built = build_mechanism(tree, ReadingOptions())
    assert built.mechanism.velocities == ("shoulder", "elbow")
    assert built.snaps == ()
    assert find_structure(built.mechanism, np.random.default_rng(0)).rank == 6


# -- refusals ----------------------------------------------------------------------------------------------------------

ARM = f'<body name="a"><joint name="a"/>{INERTIA}<body name="b"><joint name="b"/>{INERTIA}</body></body>'
REFUSED = {
    "entities": (
        '<!DOCTYPE m [<!ENTITY a "b">]><mujoco/>',
        "document type declarations and entities",
    ),
    "fragment": ("<mujocoinclude/>", "fragment"),
    "another root": ("<robot/>", "expected a <mujoco> element, found <robot>"),
    "malformed": ("<mujoco><worldbody>", "not well-formed"),
    "unknown attribute": (
        model('<body nmae="a"/>'),
        r"element 'body', line 1: MuJoCo refuses it: .*nmae",
    ),
    "unknown element": (model("<boddy/>"), "element 'boddy'"),
    "repeated name": (model('<body name="a"/><body name="a"/>'), "repeated name 'a'"),
    "deep free joint": (
        model(
            f'<body name="a">{INERTIA}<body name="b"><freejoint name="f"/>{INERTIA}</body></body>'
        ),
        "free joint can only be used on top level",
    ),
    "zero axis": (
        model(f'<body><joint name="a" axis="0 0 0"/>{INERTIA}</body>'),
        "element 'a'.*axis too small",
    ),
    "infinite": (
        model('<body name="a" pos="0 inf 0"/>'),
        r"body 'a' pos: 'inf' is not a finite number",
    ),
    "not a number": (
        model('<body name="a" quat="nan 0 0 0"/>'),
        "'nan' is not a finite number",
    ),
    "overflow": (
        model('<body name="a" pos="0 1e999 0"/>'),
        "'1e999' is not a finite number",
    ),
    "bomb": (
        model(
            '<replicate count="1000"><replicate count="1000"><body/></replicate></replicate>'
        ),
        "1000000 copies are too many",
    ),
    "too deep": (model("<body>" * 3000 + "</body>" * 3000), "nesting is too deep"),
    "no number": (
        model('<body name="a" pos="0 x 0"/>'),
        "bad format in attribute 'pos'",
    ),
    "impossible inertia": (
        model(
            '<body name="a"><inertial pos="0 0 0" mass="1" diaginertia="1 1 3"/></body>'
        ),
        "element 'a'.*A [+] B >= C",
    ),
    "contradicting couplings": (
        model(
            ARM,
            tail='<equality><joint joint1="a" polycoef="0.2 0 0 0 0"/><joint name="again" joint1="a"/></equality>',
        ),
        r"equality joint 'again': it contradicts the other equalities by -0.2",
    ),
    "coupling of no joint": (
        model(ARM, tail='<equality><joint joint1="z" joint2="b"/></equality>'),
        "z",
    ),
    "contradicting tendons": (
        model(
            ARM,
            tail='<tendon><fixed name="t"><joint joint="a" coef="2"/></fixed></tendon>'
            '<equality><tendon tendon1="t"/><joint joint1="a" polycoef="0.1 0 0 0 0"/></equality>',
        ),
        "equality tendon 't': it contradicts the other equalities",
    ),
    "spatial tendon": (
        model(
            ARM.replace("</body>", '<site name="s"/></body>', 1) + '<site name="t"/>',
            tail='<tendon><spatial name="t"><site site="s"/><site site="t"/></spatial></tendon>'
            '<equality><tendon tendon1="t"/></equality>',
        ),
        "equality tendon 't': tendon 't' is spatial; only fixed tendons are couplings of joints",
    ),
    "flex": (
        model(
            '<flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" radius=".01" dim="2" mass="1"/>'
        ),
        "flex 'cloth': deformable bodies are not supported",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refusals_name_file_and_element(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text, message = REFUSED[name]
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=message) as caught:
        read(text)
    assert caught.value.source == "robot.xml"
    assert "\n" not in str(caught.value)
    assert not list(
        tmp_path.iterdir()
    )  # MuJoCo writes a log file for what it only warns of


def test_couplings_of_coupled_joints() -> None:
    """The second constraint of a joint is one of the joints that it follows; a third one may say nothing."""
    equality = '<equality><joint joint1="a" joint2="b"/>SECOND</equality>'
    tree = read(
        model(ARM, tail=equality.replace("SECOND", '<joint joint1="b" joint2="a"/>'))
    )
    built = build_mechanism(tree, ReadingOptions(snap_tolerance=0))
    assert [c.coordinate for c in built.mechanism.couplings] == ["a"]
    assert "equality joint 'b and a' follows from the other equalities" in built.notes
    held = mechanism_of(
        read(model(ARM, tail=equality.replace("SECOND", '<joint joint1="a"/>')))
    )
    assert not {"a", "b"} & {m.name for m in held.motions}
    square = '<joint joint1="a" joint2="b" polycoef="0 1 2 0 0"/>'
    with pytest.raises(
        InputError,
        match="equality joint 'a and b': it cannot be solved for one of its joints",
    ):
        mechanism_of(read(model(ARM, tail=equality.replace("SECOND", square))))


def test_other_encodings_are_refused() -> None:
    text = '<?xml version="1.0" encoding="latin-1"?><mujoco model="é"/>'.encode(
        "latin-1"
    )
    with pytest.raises(InputError, match="not UTF-8"):
        read_mjcf(checked_mjcf(text, "robot.xml", None))


def test_missing_package_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r"echelon-robotics\[mjcf\]"):
        read(model(""))
