"""Robots as tables of parts, and the same robot as MJCF, as URDF and as a description."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Triple = tuple[float, float, float]
FREE = "free"


@dataclass(frozen=True)
class Part:
    """A body: where its frame is in its parent's, and the axis of its hinge; fixed without one, or free."""

    name: str
    parent: str
    at: Triple
    joint: str = ""
    axis: Triple | None = None
    mass: float = 1.0
    size: float = 0.2


@dataclass(frozen=True)
class Drive:
    """Friction and rotor inertia of a drive, and how far it turns per radian of each joint."""

    viscous: float = 0.0
    coulomb: float = 0.0
    rotor: float = 0.0
    ratios: Mapping[str, float] = field(default_factory=dict)

    def value(self, parameter: str) -> float:
        """Of a parameter by its kind."""
        kinds = {"Fv": self.viscous, "Fc": self.coulomb, "Ia": self.rotor}
        return next(
            value for kind, value in kinds.items() if parameter.startswith(kind)
        )

    @property
    def attributes(self) -> str:
        """In MJCF, with a friction that turns round within a few thousandths of a radian per second."""
        names = ("damping", "frictionloss", "armature")
        found = [
            f'{n}="{v}"'
            for n, v in zip(
                names, (self.viscous, self.coulomb, self.rotor), strict=True
            )
            if v
        ]
        return " ".join([*found, 'solreffriction="0.001 1"' if self.coulomb else ""])


@dataclass(frozen=True)
class Solid:
    """Mass, centre of mass, and inertia about it along the body's axes."""

    mass: float
    centre: Floats
    inertia: Floats

    @staticmethod
    def random(rng: np.random.Generator, part: Part) -> Solid:
        """A solid body of about the part's mass and size."""
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        mass = part.mass * rng.uniform(0.7, 1.4)
        spread = (
            mass * turn @ np.diag((part.size * rng.uniform(0.15, 0.4, 3)) ** 2) @ turn.T
        )
        inertia = np.trace(spread) * np.eye(3) - spread
        return Solid(
            round(mass, 4),
            (part.size * rng.uniform(-0.4, 0.4, 3)).round(4),
            inertia.round(7),
        )

    @property
    def moments(self) -> dict[str, float]:
        """By the names that URDF has for them."""
        places = {
            "xx": (0, 0),
            "yy": (1, 1),
            "zz": (2, 2),
            "xy": (0, 1),
            "xz": (0, 2),
            "yz": (1, 2),
        }
        return {name: float(self.inertia[place]) for name, place in places.items()}


def solids(parts: Sequence[Part], seed: int) -> dict[str, Solid]:
    """One for each part."""
    rng = np.random.default_rng(seed)
    return {part.name: Solid.random(rng, part) for part in parts}


def _text(values: npt.ArrayLike) -> str:
    return " ".join(f"{value:.12g}" for value in np.ravel(values))


# -- MJCF --------------------------------------------------------------------------------------------------------------


def mjcf(
    parts: Sequence[Part],
    bodies: Mapping[str, Solid],
    drives: Mapping[str, Drive],
    *,
    inside: Mapping[str, str] | None = None,
    tail: str = "",
    gravity: Triple = (0, 0, -9.81),
) -> str:
    """A model whose drives are joints, or fixed tendons where they have ratios; ``inside`` adds to bodies."""
    within = inside or {}
    tendons = "".join(
        f'<fixed name="{name}" {drive.attributes}>'
        + "".join(
            f'<joint joint="{joint}" coef="{ratio}"/>'
            for joint, ratio in drive.ratios.items()
        )
        + "</fixed>"
        for name, drive in drives.items()
        if drive.ratios
    )
    motors = "".join(
        f'<motor name="{name}" {"tendon" if drive.ratios else "joint"}="{name}"/>'
        for name, drive in drives.items()
    )
    world = "".join(
        _body(part, parts, bodies, drives, within) for part in parts if not part.parent
    )
    return (
        '<mujoco model="robot"><compiler angle="radian"/>'
        f'<option gravity="{_text(gravity)}" timestep="0.0005" integrator="RK4" tolerance="1e-14" iterations="200"/>'
        f"<worldbody>{world}</worldbody>"
        + (f"<tendon>{tendons}</tendon>" if tendons else "")
        + (f"<actuator>{motors}</actuator>" if motors else "")
        + f"{tail}</mujoco>"
    )


def _body(
    part: Part,
    parts: Sequence[Part],
    bodies: Mapping[str, Solid],
    drives: Mapping[str, Drive],
    inside: Mapping[str, str],
) -> str:
    body, drive = bodies[part.name], drives.get(part.joint, Drive())
    joint = ""
    if part.joint == FREE:
        joint = f'<freejoint name="{part.name}"/>'
    elif part.axis is not None:
        joint = (
            f'<joint name="{part.joint}" axis="{_text(part.axis)}" {drive.attributes}/>'
        )
    moments = _text([body.moments[key] for key in ("xx", "yy", "zz", "xy", "xz", "yz")])
    return (
        f'<body name="{part.name}" pos="{_text(part.at)}">{joint}'
        f'<inertial pos="{_text(body.centre)}" mass="{body.mass}" fullinertia="{moments}"/>'
        f"{inside.get(part.name, '')}"
        + "".join(
            _body(some, parts, bodies, drives, inside)
            for some in parts
            if some.parent == part.name
        )
        + "</body>"
    )


# -- URDF and descriptions ---------------------------------------------------------------------------------------------


def urdf(parts: Sequence[Part], bodies: Mapping[str, Solid]) -> str:
    """A URDF whose first part is the root link."""
    return f'<robot name="robot">{"".join(_links(parts, bodies))}</robot>'


def _links(parts: Sequence[Part], bodies: Mapping[str, Solid]) -> Iterator[str]:
    for part in parts:
        body = bodies[part.name]
        moments = " ".join(
            f'i{name}="{value:.12g}"' for name, value in body.moments.items()
        )
        yield (
            f'<link name="{part.name}"><inertial><origin xyz="{_text(body.centre)}"/><mass value="{body.mass}"/>'
            f"<inertia {moments}/></inertial></link>"
        )
        if part.axis is not None:
            yield (
                f'<joint name="{part.joint}" type="continuous"><origin xyz="{_text(part.at)}"/>'
                f'<parent link="{part.parent}"/><child link="{part.name}"/><axis xyz="{_text(part.axis)}"/></joint>'
            )


def described(
    parts: Sequence[Part], bodies: Mapping[str, Solid] | None
) -> list[dict[str, Any]]:
    """The bodies of a description, with inertial values or without."""
    found: list[dict[str, Any]] = []
    for part in parts:
        assert part.axis is not None
        joint = {
            "name": part.joint,
            "type": "revolute",
            "axis": list(part.axis),
            "origin": {"xyz": list(part.at)},
        }
        entry: dict[str, Any] = {"name": part.name, "joint": joint}
        entry |= {"parent": part.parent} if part.parent else {}
        if bodies is not None:
            body = bodies[part.name]
            entry["inertial"] = {
                "mass": body.mass,
                "com": body.centre.tolist(),
                "inertia": body.moments,
            }
        found.append(entry)
    return found
