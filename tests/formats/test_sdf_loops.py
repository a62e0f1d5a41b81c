"""SDF files with loops: mechanisms of the zoo, whose links have turned and nested frames of their own."""

from __future__ import annotations

import random
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import pytest
import yaml

import echelon as ec
from support.selection import slow_unless
from support.zoo import ZOO

TYPES = {"spherical": "ball"}
AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
EXACT = (
    0,
    0,
    0.5235987755982988,
    1.5707963267948966,
    -0.7853981633974483,
    3.141592653589793,
)
ROUNDED = (0, 0.5236, 1.5708, -0.7854, 3.1416)
GENERAL = (0.3, -1.1)


def added(start: Sequence[Fraction], shift: Sequence[str]) -> list[Fraction]:
    return [a + Fraction(b) for a, b in zip(start, shift, strict=True)]


def shown(numbers: Sequence[Fraction]) -> str:
    return " ".join(str(float(x)) for x in numbers)


def axes(joint: dict) -> str:
    found = ""
    for tag in ("axis", "axis2"):
        if tag in joint:
            xyz = (
                AXES[joint[tag]]
                if isinstance(joint[tag], str)
                else shown([Fraction(x) for x in joint[tag]])
            )
            found += f'<{tag}><xyz expressed_in="__model__">{xyz}</xyz></{tag}>'
    return found


def sdf(text: str, angles: Sequence[float], seed: int) -> str:
    """A drawn mechanism with joints and axes stated in the model, and links anywhere, in frames within frames."""
    robot, rng = yaml.load(text, yaml.BaseLoader), random.Random(seed)

    def pose(base: str) -> str:
        numbers = [rng.randint(-9, 9) / 10 for _ in range(3)] + [
            rng.choice(angles) for _ in range(3)
        ]
        return f'<pose relative_to="{base}">{" ".join(map(str, numbers))}</pose>'

    def joint(
        name: str, kind: str, at: Sequence[Fraction], ends: Sequence[str], more: str
    ) -> str:
        parent, child = ends
        where = f'<pose relative_to="__model__">{shown(at)} 0 0 0</pose>'
        ends = f"<parent>{parent}</parent><child>{child}</child>"
        return f'<joint name="_{name}" type="{TYPES.get(kind, kind)}">{where}{ends}{more}</joint>'

    at = {"base": [Fraction(0)] * 3}
    links = [
        f'<frame name="near">{pose("__model__")}</frame><frame name="far" attached_to="near">{pose("near")}</frame>'
    ]
    links += [
        '<link name="base"/>',
        joint("base", "fixed", at["base"], ("world", "base"), ""),
    ]
    for body in robot["bodies"]:
        name, parent, own = body["name"], body["parent"], body["joint"]
        at[name] = added(at[parent], own["origin"]["xyz"])
        links.append(
            f'<link name="{name}">{pose(rng.choice(("__model__", "near", "far")))}</link>'
        )
        links.append(joint(name, own["type"], at[name], (parent, name), axes(own)))
    for k, loop in enumerate(robot["loops"]):
        where = added(at[loop["connects"][0]], loop["at"]["xyz"])
        more = "" if loop["joint"] == "spherical" else axes({"axis": "z"} | loop)
        links.append(joint(f"loop{k}", loop["joint"], where, loop["connects"], more))
    gravity = " ".join(robot["gravity"])
    world = f'<gravity>{gravity}</gravity><model name="m">{"".join(links)}</model>'
    return f'<sdf version="1.9"><world name="w">{world}</world></sdf>'


def load(name: str, angles: Sequence[float], seed: int, folder: Path) -> ec.Mechanism:
    file = folder / "robot.sdf"
    file.write_text(sdf(ZOO[name].text, angles, seed), encoding="utf-8")
    return ec.load(file)


CASES = [
    (name, angles)
    for name in (
        "Peaucellier",
        "Jansen",
        "sliding coupler",
        "spherical five bar",
        "agile eye",
        "3-PRS",
        "Delta, crosses",
    )
    for angles in (EXACT, ROUNDED)
]


QUICK = ("sliding coupler",)
NESTED = [
    ("Delta, crosses", 1),
    ("Delta, crosses", 2),
    ("Delta, crosses", 3),
    ("Jansen", 1),
    ("Peaucellier", 2),
]


@pytest.mark.parametrize(
    ("name", "angles"),
    slow_unless(lambda case: case[1] is ROUNDED and case[0] in QUICK, CASES),
)
def test_ranks_do_not_depend_on_the_frames_of_links(
    name: str, angles: Sequence[float], tmp_path: Path
) -> None:
    mechanism = load(name, angles, 3, tmp_path)
    assert (mechanism.degrees_of_freedom, ec.base_structure(mechanism).rank) == (
        ZOO[name].freedom,
        ZOO[name].rank,
    )


@pytest.mark.parametrize(
    ("name", "seed"), slow_unless(lambda case: case == ("Delta, crosses", 2), NESTED)
)
@pytest.mark.slow
def test_links_may_be_turned_by_general_angles_within_one_another(
    name: str, seed: int, tmp_path: Path
) -> None:
    mechanism = load(name, GENERAL, seed, tmp_path)
    assert (mechanism.degrees_of_freedom, ec.base_structure(mechanism).rank) == (
        ZOO[name].freedom,
        ZOO[name].rank,
    )
