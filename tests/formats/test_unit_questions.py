"""Angles that look like degrees and offsets that look like millimetres are asked about; those of robots are not."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

import echelon as ec
from support.robot_files import robot_files
from support.selection import one_in


def table(*rows: str, symbols: str = "{}") -> str:
    listed = ", ".join(f"{{joint: revolute, {row}}}" for row in rows)
    return f"echelon: 1\nname: r\nsymbols: {symbols}\nmodified_dh: [{listed}]\n"


def urdf(rpy: str, xyz: str = "0.1 0 0") -> str:
    return f"""<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
      <joint name="j" type="revolute"><parent link="a"/><child link="b"/></joint>
      <joint name="k" type="revolute"><parent link="b"/><child link="c"/><origin rpy="{rpy}" xyz="{xyz}"/></joint>
      </robot>"""


def sdf(pose: str) -> str:
    joint = '<joint name="j" type="revolute"><parent>world</parent><child>a</child><axis/></joint>'
    place = "<pose>500 200 0 0 0 0</pose>"  # in a large world
    return f'<sdf version="1.9"><model name="m">{place}<link name="a"><pose>{pose}</pose></link>{joint}</model></sdf>'


ASKED = {
    "a right angle": (
        table("d: 0.4", "alpha: 90, a: 0.3"),
        r"modified_dh\[1\].alpha: 90\): degrees\? write pi/2",
    ),
    "an odd angle": (
        table("d: 0.4", "alpha: -26.565"),
        r"degrees\? write -0.463646716 for -26.565",
    ),
    "a symbol": (
        table("a: 1", "alpha: x", symbols="{x: 30}"),
        r"symbols.x: 30\): degrees\? write pi/6",
    ),
    "three quarters": (
        urdf("0 0 270"),
        r"joint 'k' origin yaw: 270\): degrees\? write 3\*pi/2",
    ),
    "several": (
        urdf("15 90 45"),
        r"yaw: 45; .*pitch: 90; .*roll: 15\): degrees\? write pi/4 \(0.785398163\)",
    ),
    "a pose": (
        sdf("0 0 0 0 0 -60"),
        r"link 'a' pose yaw: -60\): degrees\? write -pi/3",
    ),
    "millimetres": (
        table("d: 400", "a: 25", "a: 455"),
        r"joint 'j3' .* 455 m: millimetres\? write 0.455",
    ),
    "millimetres in a symbol": (
        table("d: 1", "a: l", symbols="{l: 120}"),
        r"offset of 120 m: millimetres\?",
    ),
    "millimetres of a link": (
        urdf("0 0 0", "0 0 -320"),
        r"joint 'k' has an offset of 320 m",
    ),
}


@pytest.mark.parametrize("case", ASKED)
def test_what_looks_like_another_unit_is_asked_about(case: str) -> None:
    text, question = ASKED[case]
    with pytest.warns(ec.DoubtWarning, match=question):
        robot = ec.load(text)
    assert robot.reading is not None
    with pytest.warns(ec.DoubtWarning):
        assert any("?" in note for note in ec.load(text).reading.notes)  # type: ignore[union-attr]


QUIET = {
    "a turn": table("theta: 6.2832", "alpha: 2*pi", "alpha: 9.42478"),
    "a crane": table("alpha: pi/2, d: 60", "a: 99"),
    "an angle below a turn": table("alpha: 5", "theta: 2.5"),
    "a multiple that is stated with pi": table("theta: 5*pi", "alpha: 100*pi/180"),
    "a place in the world": sdf("150 0 0 0 0 0"),
}


@pytest.mark.parametrize("case", QUIET)
def test_what_robots_have_is_not_asked_about(case: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ec.load(QUIET[case])


@pytest.mark.parametrize(
    "path",
    one_in(5, [pytest.param(path, id=name) for name, path in robot_files().items()]),
)
def test_real_robots_are_not_asked_about(path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ec.load(path, independent_mimics=True)
