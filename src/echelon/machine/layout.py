"""How a block's columns become rows of the result.

Results larger than the caches go past them, a whole cache line at a time, which spares reading every line before it is
written.  Memory is slower than the processor, so it must never wait: rows first become an image in the cache, and the
image of one block is copied out while the next block is computed.  Images that do not fit the innermost cache would
have to be read back from the next one; then rows go straight out, if their lines are whole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from echelon.machine.kernel_text import Block
from echelon.machine.lowering import Lowered
from echelon.machine.text import Vector

LINE = 8
"""Doubles in a cache line."""

_LARGEST_IMAGE = 2560  # doubles, 20 kB of an innermost cache of 32 kB
_OPERATIONS = {
    True: 3,
    False: 64,
}  # for each line copied among them: images that fit, and long ones, mostly copied apart


class Way(Enum):
    """How rows get to the result."""

    CACHED = "written directly, to be read soon"
    STREAMED = "written directly, past the caches"
    IMAGED = "by way of an image, past the caches"


@dataclass(frozen=True)
class Rows:
    """Rows made of a block's columns.

    Attributes
    ----------
    block : Block
        Of as many samples as its vectors have lanes.
    places : tuple of int
        For each column of the row, the entry of the block, or −1 for a structural zero.
    way : Way
    """

    block: Block
    places: tuple[int, ...]
    way: Way

    @property
    def image(self) -> int:
        """Offset of the image in the buffer; zero at first."""
        return -(-self.block.doubles // LINE) * LINE

    @property
    def lines(self) -> int:
        """Lines of an image that are whole wherever its copy begins."""
        return max(0, self.block.vector.lanes * len(self.places) // LINE - 1)

    @property
    def spare(self) -> int:
        """Offset of a place to which the first block streams, when there is no image yet."""
        return self.image + self._room

    @property
    def doubles(self) -> int:
        """Doubles that the buffer must hold."""
        return self.spare + (self._room if self.way is Way.IMAGED else 0)

    @property
    def _room(self) -> int:
        return -(-(self.block.vector.lanes * len(self.places) + LINE) // LINE) * LINE


def rows_of(lowered: Lowered, vector: Vector, places: tuple[int, ...], *, big: bool) -> Rows:
    """The best way for rows.

    Parameters
    ----------
    lowered : Lowered
    vector : Vector
    places : tuple of int
        For each column of the row, the entry of the function, or −1 for a structural zero.
    big : bool
        Whether the whole result is larger than the caches.
    """
    direct = Rows(Block(lowered, vector, vector.lanes), places, Way.CACHED)
    fits = vector.lanes * len(places) <= _LARGEST_IMAGE
    if big and not fits and not len(places) % LINE:
        return replace(direct, way=Way.STREAMED)
    streamed = min(direct.lines, lowered.length // _OPERATIONS[fits])
    if not (big and streamed):
        return direct
    return Rows(replace(direct.block, streamed=streamed), places, Way.IMAGED)
