"""Published mechanisms with loops, with the ranks that `loop_oracle` finds for them at closed states.

A URDF file is read with the YAML file beside it (`tests/data/loops/README.md`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from support.paths import TESTS

LOOPS = TESTS / "data" / "loops"


@dataclass(frozen=True)
class Published:
    """A model with its degrees of freedom and base parameters; all links with joints count, whatever their mass.

    Attributes
    ----------
    name : str
        A folder with `robot.urdf` and `robot.yaml`, or an MJCF file.
    freedom, rank : int
        With the numbers as intended: angles next to multiples of 15 degrees exact, twelve decimals.
    floating : bool
        The root link of the URDF file is free instead of fixed; in MJCF files a free joint says so.
    """

    name: str
    freedom: int
    rank: int
    floating: bool = False

    @property
    def file(self) -> Path:
        here = LOOPS / self.name
        return here / "robot.urdf" if here.is_dir() else here.with_suffix(".xml")

    def __str__(self) -> str:
        return f"{self.name}{' floating' * self.floating}"


PUBLISHED = (
    Published("planar_2dof", 2, 11),
    Published("five_bar", 3, 14),
    Published("planar_delta", 5, 30),
    Published("palletizer", 3, 20),
    Published("palletizer_kr700", 4, 22),
    Published("palletizer_kr700_general", 4, 44),
    Published("palletizer_mpl800", 4, 25),
    Published("palletizer_mpl800_general", 4, 55),
    Published("picker_tdr2040", 2, 11),
    Published("delta_pins", 3, 40),
    Published("xarm7_gripper", 1, 3),
    Published("robotiq_2f85", 3, 19),
    Published("robotiq_2f85_v4", 1, 13),
    Published("robotiq_140", 2, 14),
    Published("robotiq_3_finger", 4, 34),
    Published("jaco_3_finger", 3, 9),
    Published("reachy_mini", 15, 115),
    Published("cassie", 22, 160),
    Published("cassie_leg", 8, 71),
    Published("cassie_like", 7, 109),
    Published("cassie_like", 13, 123, floating=True),
    Published("talos_like", 7, 51),
    Published("talos_like", 13, 67, floating=True),
    Published("digit_like", 9, 83),
    Published("digit_like_links", 9, 155),
    Published("digit_like_2legs", 12, 166),
    Published("digit_like_2legs", 18, 184, floating=True),
    Published("disney_like", 9, 151),
    Published("disney_like", 15, 169, floating=True),
    Published("wl16_like", 12, 82),
    Published("wl16_like", 18, 92, floating=True),
    Published("wl16_like_links", 12, 199),
    Published("battobot", 12, 154),
    Published("battobot", 18, 176, floating=True),
    Published("talos", 46, 344),
    Published("talos", 52, 372, floating=True),
)

ASSEMBLED = (
    Published("disney_robot", 16, 168),
    Published("kangaroo_like", 19, 201),
    Published("marcheur_4", 15, 178),
)
"""Models that are open at zero, with ranks that `loop_oracle` finds from where they are assembled, in steps of 0.004.

From zero, or in longer steps, it comes to other modes.
"""

LITERAL = {"battobot": 166}
"""Ranks with all digits as they stand, where noise of rounding does not lock the loops and changes the rank."""

LOCKED = ("toddlerbot_neck",)
"""Models whose loops are closed within rounding only: rods that are meant to be equally long differ by 0.05 mm."""
