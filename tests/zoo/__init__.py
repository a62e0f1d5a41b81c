"""Mechanisms with loops, as texts of descriptions and MJCF files, with their freedoms and ranks."""

from __future__ import annotations

from zoo.bars import BARS
from zoo.case import Case
from zoo.cranks import CRANKS
from zoo.floating import FLOATING
from zoo.legs import LEGS
from zoo.machines import MACHINES
from zoo.mjcf_linkages import MJCF_LINKAGES
from zoo.mjcf_text import mjcf
from zoo.platforms import PLATFORMS
from zoo.spatial import SPATIAL

__all__ = ["ZOO", "Case", "mjcf"]

ZOO = CRANKS | BARS | FLOATING | SPATIAL | MACHINES | MJCF_LINKAGES | PLATFORMS | LEGS
