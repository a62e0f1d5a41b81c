"""Exports: a mechanism in a format, with some digits, in frames of a kind, in metres or millimetres."""

from __future__ import annotations

import random
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from support.rounded_exports.mechanism import Exact
from support.rounded_exports.table import NAMES, build

FORMATS = {"mjcf": "m", "mjcf_sites": "t", "urdf": "u", "urdf_pairs": "p", "sdf": "s"}
"""With a letter; in the second and fourth one, both frames of a closure are stated, each rounded on its own."""
FRAMES = {"world": "w", "natural": "n", "random": "r"}
"""Link frames along the world, with z along the joint's axis, or turned at random with origins anywhere on the axis."""
DIGITS = (3, 4, 5, 6, 7, 8, 9, 10, 12, 15, 17)
"""Decimals of all numbers in a file."""
UNITS = {"m": "", "mm": "k"}


@dataclass(frozen=True)
class Export:
    """One file, of which `code` is the name: mechanism, format, digits, frames, and k for millimetres."""

    mechanism: str
    format: str
    digits: int
    frames: str
    unit: str = "m"

    @property
    def code(self) -> str:
        return f"{self.mechanism}__{FORMATS[self.format]}{self.digits}{FRAMES[self.frames]}{UNITS[self.unit]}"

    def __str__(self) -> str:
        return self.code

    @property
    def exact(self) -> Exact:
        return build(self.mechanism)

    @property
    def to_be_freed(self) -> bool:
        """The base floats, and the file cannot say so."""
        return self.exact.floating and not self.format.startswith("mjcf")

    @property
    def seed(self) -> int:
        return zlib.crc32(self.code.encode())


def named(code: str) -> Export:
    """The export of a code such as `scissor_two__m4w`."""
    mechanism, _, rest = code.partition("__")
    letter, rest, unit = (
        rest[0],
        rest[1:].removesuffix("k"),
        "mm" if rest.endswith("k") else "m",
    )
    kinds = {value: key for key, value in FORMATS.items()}
    frames = {value: key for key, value in FRAMES.items()}
    return Export(mechanism, kinds[letter], int(rest[:-1]), frames[rest[-1]], unit)


def all_exports() -> Iterator[Export]:
    for name, form, digits, frames in product(NAMES, FORMATS, DIGITS, FRAMES):
        yield Export(name, form, digits, frames)
    for name, form, frames in product(NAMES, FORMATS, FRAMES):
        yield Export(name, form, 5, frames, "mm")


PLAIN = (
    "scissor_one", "scissor_two", "scissor_two-moved", "remote_center", "sarrus", "peaucellier", "hoberman", "hart",
    "three_cranks", "bennett", "parallel_gripper", "four_bar_across",
)  # fmt: skip
"""Mechanisms that are special, so that few decimals break what their ranks depend on."""


def plain_exports() -> list[Export]:
    """Special mechanisms with links along the world and few digits."""
    return [
        Export(name, form, digits, "world")
        for name, form, digits in product(PLAIN, FORMATS, (3, 4))
    ]


def some_exports(
    count: int, seed: int = 0, names: tuple[str, ...] = NAMES
) -> list[Export]:
    """Exports in which all mechanisms, formats, digits and frames come about equally often."""
    draw = random.Random(seed)

    def endless(values: tuple) -> Iterator:
        while True:
            yield from draw.sample(values, len(values))

    parts = zip(
        endless(names),
        endless(tuple(FORMATS)),
        endless(DIGITS),
        endless(tuple(FRAMES)),
        strict=False,
    )
    units = (draw.random() < 0.1 for _ in range(count))
    return [Export(*next(parts), "mm" if small else "m") for small in units]
