"""Descriptions of random mechanisms with loops, closed at zero: in round numbers, or rounded in random frames."""

from __future__ import annotations

import random
from dataclasses import dataclass, field

import numpy as np
import sympy
import yaml
from scipy.spatial.transform import Rotation

HELD = {
    "weld": 6, "revolute": 5, "prismatic": 5, "cylindrical": 4, "planar": 3, "universal": 4, "spherical": 3,
    "point_on_axis": 2, "point_on_plane": 1,
}  # fmt: skip
FREEDOMS = {"spherical": 3, "universal": 2, "cylindrical": 2}
PLAIN = ("x", "y", "z", "-x")
DIRECTIONS = (
    *PLAIN,
    "[1, 2, 0]",
    "[0, 3, 4]",
    "[1, 1, 1]",
    "[1, -2, 2]",
    "[2, 0, 3]",
    "[1, 1, 0]",
)
RATIOS = ("2", "-1/2", "0.5", "-1", "sqrt(2)", "3.7")


@dataclass
class RandomLinkage:
    """A tree of three to eight bodies, one or two loops of any kind, sometimes planar, geared or floating."""

    seed: int
    draw: random.Random = field(init=False)

    def __post_init__(self) -> None:
        self.draw = random.Random(self.seed)
        self.plane = self.draw.choice(DIRECTIONS) if self.draw.random() < 0.3 else ""

    def often(self, share: float) -> bool:
        return self.draw.random() < share

    def point(self) -> str:
        draw = self.draw
        numbers = [
            draw.choice([0, 0, round(draw.uniform(-0.5, 0.5), draw.choice([1, 2, 3]))])
            for _ in range(3)
        ]
        return f"xyz: {numbers}"

    def axis(self) -> str:
        return self.plane or self.draw.choice(PLAIN if self.often(0.6) else DIRECTIONS)

    def turn(self, share: float) -> str:
        if self.plane or not self.often(share):
            return ""
        roll, pitch, yaw = (
            self.draw.choice(some.split())
            for some in ("0 pi/2 pi/3 0.3", "0 pi/4 -0.7", "0 pi/6")
        )
        return f", rpy: [{roll}, {pitch}, {yaw}]"

    def kind(self) -> str:
        kinds = (
            "revolute",
            "prismatic",
            "spherical",
            "universal",
            "cylindrical",
            "helical",
        )
        return (
            "revolute"
            if self.plane
            else self.draw.choices(kinds, (55, 15, 12, 10, 5, 3))[0]
        )

    def joint(self, kind: str) -> str:
        if kind == "spherical":
            return f"type: {kind}"
        if kind == "universal":
            return f"type: {kind}, axis: {{}}, axis2: {{}}".format(
                *self.draw.sample("xyz", 2)
            )
        return f"type: {kind}, axis: {self.axis()}" + ", pitch: 0.01" * (
            kind == "helical"
        )

    def text(self) -> str:
        """The description, without its first line."""
        draw, count = self.draw, self.draw.randint(3, 8)
        kinds = [self.kind() for _ in range(count)]
        bodies = ["  - {name: fl, joint: {type: floating}}"] * self.often(0.1)
        for k, kind in enumerate(kinds):
            parent = (
                "base"
                if k == 0 or self.often(0.15)
                else f"b{draw.choice([k - 1, k - 1, draw.randrange(k)])}"
            )
            joint = f"{self.joint(kind)}, origin: {{{self.point()}{self.turn(0.2)}}}"
            bodies.append(f"  - {{name: b{k}, parent: {parent}, joint: {{{joint}}}}}")
        text = "\n".join(
            [
                "bodies:",
                *bodies,
                "loops:",
                *self.loops(count, sum(FREEDOMS.get(k, 1) for k in kinds)),
            ]
        )
        turning = [k for k, kind in enumerate(kinds) if kind == "revolute"]
        if len(turning) > 3 and self.often(0.25):
            follower, leader = draw.sample(turning, 2)
            text += f"\ncouplings: [b{follower}: {draw.choice(RATIOS)}*b{leader}]"
        return text + "\n"

    def loops(self, count: int, freedoms: int) -> list[str]:
        draw, found = self.draw, list[str]()
        for _ in range(draw.choice([1, 1, 2])):
            first = draw.randrange(count)
            second = draw.choice(
                ["base", *(f"b{k}" for k in range(count) if k != first)]
            )
            held = dict.fromkeys(
                ("revolute", "spherical", "universal", "cylindrical", "planar"), 2
            )
            held = {
                kind: n
                for kind, n in (held if self.plane else HELD).items()
                if n < freedoms
            }
            if not held:
                break
            kind = draw.choice(list(held))
            freedoms -= held[kind]
            axis = (
                ""
                if kind in ("spherical", "weld", "universal")
                else f"axis: {self.axis()}, "
            )
            at = f"at: {{{self.point()}{self.turn(0.3)}}}"
            found.append(
                f"  - {{joint: {kind}, connects: [b{first}, {second}], {axis}{at}}}"
            )
        return found


NAMED = {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1], "-x": [-1, 0, 0]}


def number(text: str) -> float:
    return float(sympy.sympify(text))


def placed(frame: dict) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = [number(x) for x in frame.get("xyz", "000")]
    pose[:3, :3] = Rotation.from_euler(
        "xyz", [number(x) for x in frame.get("rpy", "000")]
    ).as_matrix()
    return pose


def pointing(axis: str | list[str]) -> np.ndarray:
    along = np.array(
        NAMED[axis] if isinstance(axis, str) else [number(x) for x in axis], dtype=float
    )
    return along / np.linalg.norm(along)


def aimed(axis: str | list[str]) -> np.ndarray:
    """A frame whose z lies along an axis."""
    z, pose = pointing(axis), np.eye(4)
    x = np.cross([0.3, 0.5, 0.7], z)
    x /= np.linalg.norm(x)
    pose[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    return pose


def may_be_turned(text: str) -> bool:
    """Whether links may stand in any frames: the axes of universal joints are those of frames."""
    return "universal" not in text and "floating" not in text


def in_random_frames(text: str, seed: int, digits: int) -> str:
    """The same mechanism, with links in random frames and rounded numbers."""
    robot, rng = yaml.load(text, yaml.BaseLoader), np.random.default_rng(seed)

    def shown(numbers: np.ndarray) -> str:
        return ", ".join(f"{round(float(x), digits) + 0.0:.{digits}f}" for x in numbers)

    def frame(pose: np.ndarray) -> str:
        angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz")
        return f"{{xyz: [{shown(pose[:3, 3])}], rpy: [{shown(angles)}]}}"

    turned, lines = {"base": np.eye(4)}, ["bodies:"]
    for body in robot["bodies"]:
        name, parent, joint = body["name"], body["parent"], body["joint"]
        turned[name] = np.eye(4)
        turned[name][:3, :3] = Rotation.random(random_state=rng).as_matrix()
        origin = np.linalg.inv(turned[parent]) @ placed(joint["origin"]) @ turned[name]
        axis = (
            f", axis: [{shown(turned[name][:3, :3].T @ pointing(joint['axis']))}]"
            if "axis" in joint
            else ""
        )
        pitch = f", pitch: {joint['pitch']}" if "pitch" in joint else ""
        kind = f"type: {joint['type']}{axis}{pitch}"
        lines.append(
            f"  - {{name: {name}, parent: {parent}, joint: {{{kind}, origin: {frame(origin)}}}}}"
        )
    lines.append("loops:")
    for loop in robot["loops"]:
        first, second = loop["connects"]
        at = (
            np.linalg.inv(turned[first])
            @ placed(loop["at"])
            @ (aimed(loop["axis"]) if "axis" in loop else np.eye(4))
        )
        lines.append(
            f"  - {{joint: {loop['joint']}, connects: [{first}, {second}], at: {frame(at)}}}"
        )
    couplings = [
        f"{name}: {ratio}"
        for entry in robot.get("couplings", ())
        for name, ratio in entry.items()
    ]
    return "\n".join([*lines, *(f"couplings: [{c}]" for c in couplings)]) + "\n"
