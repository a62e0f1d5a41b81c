"""Random trees as URDF text, with solid bodies; for oracles that read URDF on their own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
AXES = ("1 0 0", "0 1 0", "0 0 1")
TURNS = ("0 0 0", "1.57079632679 0 0", "0 -1.57079632679 0", "0.3 0.4 -1.1")


@dataclass(frozen=True)
class RandomLink:
    """A link with the joint that carries it."""

    name: str
    parent: str
    joint: str
    kind: str
    xyz: Floats
    rpy: str
    axis: str
    mass: float
    centre: Floats
    inertia: Floats  # about the centre of mass

    def heavier(self, share: float) -> RandomLink:
        """A body of more mass, elsewhere."""
        moved = self.centre + 0.05 * share
        return replace(
            self,
            mass=self.mass * (1 + share),
            centre=moved,
            inertia=self.inertia * (1 + share),
        )


def random_links(rng: np.random.Generator, count: int) -> list[RandomLink]:
    """Links of a tree on 'base'; one in five slides."""
    links = []
    for k in range(1, count + 1):
        at = int(rng.integers(max(0, k - 2), k))
        root = rng.normal(size=(3, 5)) * 0.05
        mass = float(rng.uniform(0.5, 4))
        second = mass * root @ root.T + 1e-3 * np.eye(3)
        links.append(
            RandomLink(
                f"l{k}",
                f"l{at}" if at else "base",
                f"j{k}",
                "prismatic" if rng.random() < 0.2 else "revolute",
                rng.uniform(-0.4, 0.4, 3).round(3),
                TURNS[rng.integers(len(TURNS))],
                AXES[rng.integers(3)],
                mass,
                rng.uniform(-0.1, 0.1, 3),
                np.trace(second) * np.eye(3) - second,
            )
        )
    return links


def urdf(links: list[RandomLink], names: Mapping[str, str] | None = None) -> str:
    """The robot as text; joints may have other names."""
    shown = names or {}
    parts = ["<robot name='random'><link name='base'/>"]
    for link in links:
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = link.inertia.tolist()
        parts.append(
            f"<link name='{link.name}'><inertial><origin xyz='{_words(link.centre)}'/><mass value='{link.mass!r}'/>"
            f"<inertia ixx='{xx!r}' ixy='{xy!r}' ixz='{xz!r}' iyy='{yy!r}' iyz='{yz!r}' izz='{zz!r}'/></inertial></link>"
        )
        joint = shown.get(link.joint, link.joint)
        parts.append(
            f"<joint name='{joint}' type='{link.kind}'><parent link='{link.parent}'/><child link='{link.name}'/>"
            f"<origin xyz='{_words(link.xyz)}' rpy='{link.rpy}'/><axis xyz='{link.axis}'/>"
            "<limit lower='-1.5' upper='1.2' velocity='2' effort='9'/></joint>"
        )
    return "\n".join([*parts, "</robot>"])


def _words(values: Floats) -> str:
    return " ".join(repr(float(value)) for value in values)
