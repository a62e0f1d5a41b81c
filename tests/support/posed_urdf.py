"""Robots by the axes of their joints, written as URDF with any zeros and directions of joints and any base frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

Floats = npt.NDArray[np.float64]
INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    "</inertial>"
)
JOINT = (
    '<joint name="j{k}" type="{kind}"><parent link="{parent}"/><child link="l{k}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
    '<axis xyz="{axis}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
)


@dataclass(frozen=True)
class Axes:
    """A tree of joints by axes through points, in one pose."""

    directions: list[Floats]
    points: list[Floats]
    slides: list[bool]
    parents: list[int]  # -1 for the base

    @staticmethod
    def random(rng: np.random.Generator, *, oblique: bool) -> Axes:
        """Up to six joints; along the base's axes and often through one point, or anywhere."""
        n = int(rng.integers(2, 7))
        if oblique:
            directions = [d / np.linalg.norm(d) for d in rng.normal(size=(n, 3))]
        else:
            directions = [np.eye(3)[k] for k in rng.integers(3, size=n)]
        points = np.round(rng.uniform(-0.5, 0.5, (n, 3)), 2)
        points = points * (oblique | (rng.random((n, 3)) < 0.6))
        parents = [-1] + [int(rng.integers(max(0, k - 2), k)) for k in range(1, n)]
        slides = [k > 0 and bool(rng.random() < 0.2) for k in range(n)]
        return Axes(directions, list(points), slides, parents)

    def moved(self, k: int, amount: float) -> Floats:
        """The displacement of a joint, shape (4, 4)."""
        move = np.eye(4)
        if self.slides[k]:
            move[:3, 3] = amount * self.directions[k]
        else:
            turn = Rotation.from_rotvec(amount * self.directions[k]).as_matrix()
            move[:3, :3], move[:3, 3] = turn, self.points[k] - turn @ self.points[k]
        return move


@dataclass(frozen=True)
class Description:
    """How a file describes axes: where joints count as zero, which way, and where the base stands."""

    axes: Axes
    zeros: dict[int, float] = field(default_factory=dict)
    reversed: frozenset[int] = frozenset()
    base: Floats = field(default_factory=lambda: np.eye(4))

    def urdf(self) -> str:
        """The file."""
        axes = self.axes
        frames: list[Floats] = []
        parts = ['<link name="base"/>']
        for k, parent in enumerate(axes.parents):
            frame = np.eye(4)
            frame[:3, 3] = axes.points[k]
            at = k
            while at >= 0:
                frame = axes.moved(at, self.zeros.get(at, 0.0)) @ frame
                at = axes.parents[at]
            frames.append(self.base @ frame)
            before = frames[parent] if parent >= 0 else np.eye(4)
            step = np.linalg.solve(before, frames[k])
            rpy = Rotation.from_matrix(step[:3, :3]).as_euler("xyz")
            sign = -1 if k in self.reversed else 1
            parts.append(f'<link name="l{k}">{INERTIAL}</link>')
            parts.append(
                JOINT.format(
                    k=k,
                    kind="prismatic" if axes.slides[k] else "revolute",
                    parent=f"l{parent}" if parent >= 0 else "base",
                    xyz=_numbers(step[:3, 3]),
                    rpy=_numbers(rpy),
                    axis=_numbers(sign * axes.directions[k]),
                )
            )
        return f'<robot name="axes">{"".join(parts)}</robot>'


def _numbers(values: Floats) -> str:
    return " ".join(f"{x:.15f}" for x in values)
