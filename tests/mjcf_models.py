"""Texts of MJCF models, and how they are read."""

from __future__ import annotations

from pathlib import Path

from echelon.formats.build import build_mechanism
from echelon.formats.literal import LiteralTree
from echelon.formats.mjcf import read_mjcf
from echelon.formats.options import ReadingOptions
from echelon.mechanism.mechanism import Mechanism

INERTIA = (
    '<inertial pos="0.05 -0.02 0.11" mass="1.3" euler="0.2 0.3 -0.4" diaginertia="0.021 0.017 0.012"/>'
    '<geom type="sphere" size="0.01"/>'
)
"""What a body weighs, and a geom that does not matter beside it."""


def read(text: str, directory: Path | None = None, mimics: bool = True) -> LiteralTree:
    return read_mjcf(text, "robot.xml", directory, mimics=mimics)


def model(worldbody: str, head: str = "", tail: str = "") -> str:
    return f"<mujoco>{head}<worldbody>{worldbody}</worldbody>{tail}</mujoco>"


def mechanism_of(tree: LiteralTree) -> Mechanism:
    return build_mechanism(tree, ReadingOptions(tolerance=0))
