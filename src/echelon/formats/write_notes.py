"""What written robot files say about themselves: remarks that belong to every format."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from echelon.formats.write_values import ROTOR, IdentifiedValues
from echelon.formats.write_xml import comment
from echelon.mechanism.mechanism import Mechanism

_NOTICEABLE = 1e-9
"""Numbers that were read as exact ones within this differ in their last digits only."""


def head_comment(notes: Sequence[str]) -> list[str]:
    """Lines of the comment at the head of a written file."""
    return comment(["Inertial parameters identified with Echelon.", *(f"Note: {note}." for note in notes)])


def listed(names: Iterable[str], most: int = 12) -> str:
    """Names in quotes, and how many more there are."""
    every = [f"'{name}'" for name in names]
    return ", ".join(every[:most]) + (f" and {len(every) - most} more" if len(every) > most else "")


def rotor_notes(mechanism: Mechanism, values: IdentifiedValues, file_format: str) -> Iterator[str]:
    """Spin inertias of rotors that are bodies of their own, which no robot file has."""
    spins = [
        f"{parameter.name} = {float(values.bodies[parameter.body][parameter.kind])!r} {parameter.unit}"
        for parameter in mechanism.columns
        if parameter.body is not None
        and parameter.kind is not None
        and mechanism.bodies[parameter.body].joint.kind == ROTOR
    ]
    if spins:
        yield f"{file_format} has no rotors that turn with joints, left out: {', '.join(spins)}"


def reading_notes(mechanism: Mechanism, values: IdentifiedValues, root: Any, file_format: str) -> Iterator[str]:
    """Remarks on an edited file: rotors, numbers that were read as others, files that it refers to."""
    yield from rotor_notes(mechanism, values, file_format)
    snaps = mechanism.reading.snaps if mechanism.reading is not None else ()
    moved = [snap.difference for snap in snaps if snap.difference > _NOTICEABLE]
    if moved:
        yield (
            f"{len(moved)} numbers of the geometry stay as written although they were read as exact ones, "
            f"up to {np.max(moved):.2g} away; predictions of this file differ accordingly"
        )
    if any(_is_relative(value) for e in root.iter() for key, value in e.items() if key in ("filename", "file")):
        yield "files that it refers to are looked for relative to the folder of the input"


def _is_relative(path: str) -> bool:
    return "://" not in path and not PurePath(path).is_absolute()
