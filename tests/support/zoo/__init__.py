"""Mechanisms with loops, as texts of descriptions and MJCF files, with their freedoms and ranks."""

from __future__ import annotations

from support.zoo.bars import BARS
from support.zoo.case import Case
from support.zoo.cranks import CRANKS
from support.zoo.floating import FLOATING
from support.zoo.legs import LEGS
from support.zoo.linkages import LINKAGES
from support.zoo.machines import MACHINES
from support.zoo.mjcf_linkages import MJCF_LINKAGES
from support.zoo.mjcf_text import mjcf
from support.zoo.platforms import PLATFORMS
from support.zoo.spatial import SPATIAL

__all__ = ["ZOO", "Case", "mjcf"]

ZOO = (
    CRANKS
    | BARS
    | FLOATING
    | SPATIAL
    | MACHINES
    | MJCF_LINKAGES
    | PLATFORMS
    | LEGS
    | LINKAGES
)
