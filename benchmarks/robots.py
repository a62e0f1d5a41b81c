"""The robots of the comparison, each as an exact mechanism and as a Pinocchio model of the same joints and bodies."""

from __future__ import annotations

import site
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

import echelon as ec
from echelon.algebra.exact.expressions import parse, parse_angle
from echelon.algebra.exact.polynomial import Polynomial, float_generators
from echelon.robot.joint import (
    GROUND,
    Body,
    Joint,
    Motion,
    Placement,
    Symbol,
    merge,
    rotation,
    shift,
    turn,
)
from echelon.robot.mechanism import Mechanism

PANDA_FILE = Path(__file__).parents[1] / "examples" / "panda.yaml"
_PANDA = {
    "d1": "0.333",
    "d3": "0.316",
    "d5": "0.384",
    "a4": "0.0825",
    "a5": "-0.0825",
    "a7": "0.088",
}
_PANDA_ROWS = (
    ("0", "0", "d1"),
    ("-pi/2", "0", "0"),
    ("pi/2", "0", "d3"),
    ("pi/2", "a4", "0"),
    ("-pi/2", "a5", "d5"),
    ("pi/2", "0", "0"),
    ("pi/2", "a7", "0"),
)


@dataclass(frozen=True)
class Robot:
    """One row of the comparison.

    Attributes
    ----------
    name, variant : str
    exact : callable
        Makes the mechanism.
    numeric : callable
        Makes the Pinocchio model.
    """

    name: str
    variant: str
    exact: Callable[[], Mechanism]
    numeric: Callable[[], Any]


def panda() -> Robot:
    """The arm of the example file, or, where that is absent, the same table with six symbolic lengths."""

    def exact() -> Mechanism:
        return (
            ec.load(PANDA_FILE)
            if PANDA_FILE.exists()
            else modified_dh("panda", _PANDA_ROWS, _PANDA)
        )

    return Robot("panda", "arm, fixed base", exact, lambda: serial_model(exact()))


def chain(joints: int) -> Mechanism:
    """A serial chain of revolute joints, each at a right angle to the one before, with two symbolic offsets between."""
    random = Random(joints)
    rows, values = [("0", "0", "0")], {}
    for i in range(2, joints + 1):
        rows.append(("-pi/2" if i % 2 else "pi/2", f"a{i}", f"d{i}"))
        values |= {
            f"a{i}": f"0.{random.randint(100, 399)}",
            f"d{i}": f"0.{random.randint(100, 399)}",
        }
    return modified_dh(f"chain of {joints}", rows, values)


def binary_tree(bodies: int) -> Mechanism:
    """Every body carries two others on revolute joints, each placed by two symbolic offsets."""
    random = Random(bodies)
    values = {
        f"{s}{i}": f"0.{random.randint(100, 399)}"
        for i in range(2, bodies + 1)
        for s in "ad"
    }
    tree = []
    for i in range(1, bodies + 1):
        offsets = shift(parse(f"a{i}"), parse(f"d{i}"), 0) if i > 1 else shift(0, 0, 0)
        steps = (offsets, turn(i % 2, parse_angle("pi/2")), rotation(f"q{i}"))
        tree.append(
            Body(
                f"link{i}", str(i), i // 2 - 1, Joint(f"q{i}", "revolute", merge(steps))
            )
        )
    symbols = {s: Symbol(s, float(text), text) for s, text in values.items()}
    gravity = (parse("0"), parse("0"), parse("-9.81"))
    return Mechanism(f"binary tree of {bodies}", tuple(tree), gravity, symbols=symbols)


def modified_dh(name: str, rows: Any, values: dict[str, str]) -> Mechanism:
    """A serial arm from rows (alpha, a, d) of a modified DH table (Khalil–Kleinfinger, Craig)."""
    bodies = []
    for i, (alpha, a, d) in enumerate(rows):
        steps = (
            shift(parse(a), 0, 0),
            turn(0, parse_angle(alpha)),
            shift(0, 0, parse(d)),
            rotation(f"q{i + 1}"),
        )
        joint = Joint(f"q{i + 1}", "revolute", merge(steps))
        bodies.append(Body(f"link{i + 1}", str(i + 1), i - 1 if i else GROUND, joint))
    symbols = {s: Symbol(s, float(text), text) for s, text in values.items()}
    return Mechanism(
        name, tuple(bodies), (parse("0"), parse("0"), parse("-9.81")), symbols=symbols
    )


def published(name: str, file: str, *, floating: bool) -> Robot:
    """A robot of the package example-robot-data.

    Mimic joints are independent for both sides, because Pinocchio reads them so.
    """
    path = find_urdf(file)

    def exact() -> Mechanism:
        return ec.load(path, floating=floating, independent_mimics=True)

    def numeric() -> Any:
        import pinocchio as pin

        arguments = (str(path), pin.JointModelFreeFlyer()) if floating else (str(path),)
        return pin.buildModelFromUrdf(*arguments)

    return Robot(name, "floating base" if floating else "fixed base", exact, numeric)


def find_urdf(file: str) -> Path:
    """A URDF file of the package example-robot-data by its name."""
    for packages in site.getsitepackages():
        root = Path(packages) / "cmeel.prefix" / "share" / "example-robot-data"
        for path in sorted(root.rglob(file)):
            return path
    raise SystemExit(
        f"{file} not found: pip install 'echelon-robotics[bench]' brings the package example-robot-data"
    )


def serial_model(mechanism: Mechanism) -> Any:
    """A mechanism of revolute joints about z as a Pinocchio model, with the symbols' values."""
    import pinocchio as pin

    values = {
        name: s.value for name, s in mechanism.symbols.items() if s.value is not None
    }

    def number(entry: Polynomial) -> float:
        return entry.evaluate(float_generators(entry.generators(), values), float)

    model = pin.Model()
    index = {GROUND: 0}
    for i, body in enumerate(mechanism.bodies):
        place = pin.SE3.Identity()
        for step in body.joint.steps:
            if isinstance(step, Placement):
                rows = np.array([[number(e) for e in row] for row in step.rotation])
                place = place * pin.SE3(
                    rows, np.array([number(e) for e in step.translation])
                )
            elif isinstance(step, Motion):
                index[i] = model.addJoint(
                    index[body.parent], pin.JointModelRZ(), place, body.joint.name
                )
                place = pin.SE3.Identity()
        model.appendBodyToJoint(index[i], pin.Inertia.Random(), pin.SE3.Identity())
    return model
