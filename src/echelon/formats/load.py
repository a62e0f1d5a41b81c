"""Open a robot file of any supported format."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Literal

from echelon.formats.options import ANGLE_TOLERANCE, Gravity, ReadingOptions
from echelon.formats.robot_file import open_robot
from echelon.mechanism.mechanism import Mechanism
from echelon.models.linear_model import LinearModel


def load(
    path: str | os.PathLike[str],
    *,
    tolerance: float = ANGLE_TOLERANCE,
    symbolic: bool = True,
    floating: bool = False,
    every_link: bool = False,
    independent_mimics: bool = False,
    massless: Sequence[str] = (),
    gravity: Gravity = "file",
    separate_symbols: bool = False,
    measured: Literal["drives", "file"] = "drives",
) -> Mechanism:
    """Read a robot description.

    Parameters
    ----------
    path : path-like
        A URDF, SDF, MJCF or Echelon description file; the content decides between XML formats.
    tolerance : float
        Angles this near (rad) to a multiple of 15° and axes this near to a coordinate direction are read as exact; 0
        switches this off.
    symbolic : bool
        Give lengths of URDF and MJCF files symbols (``px4``: x offset of joint 4), or keep them as exact numbers, as
        with loops in any case.  Without symbols, those of a description become their values too; only angles without
        an exact sine stay symbols.
    floating : bool
        Let the root link float.
    every_link : bool
        Keep links that are fixed to others as bodies with parameters of their own.
    independent_mimics : bool
        Ignore mimic elements and equality couplings, as most programs do.
    massless : sequence of str
        Links that carry no parameters.
    gravity : "file", "generic", None or 3 numbers or expressions
        Gravity in the base frame, m/s².
    separate_symbols : bool
        Give every number of a URDF or MJCF file a symbol of its own; otherwise equal magnitudes share one.
    measured : "drives" or "file"
        What is measured: the forces of all drives, or what the sensors of an MJCF file measure (see
        ``docs/formats/mjcf.md``).  Descriptions state their outputs themselves.

    Returns
    -------
    Mechanism

    Raises
    ------
    InputError
        If the file cannot be read or is not a valid robot; the message names file and element.

    Examples
    --------
    >>> import echelon as ec
    >>> print(ec.load("examples/panda.yaml"))
    panda: 7 bodies, 7 degrees of freedom
    """
    options = ReadingOptions(
        tolerance,
        symbolic,
        floating,
        every_link,
        independent_mimics,
        tuple(massless),
        gravity,
        separate_symbols=separate_symbols,
        measured=measured,
    )
    return open_robot(path).mechanism(options)


def load_model(path: str | os.PathLike[str], **reading: Any) -> Mechanism | LinearModel:
    """Read a robot, with the keyword arguments of :func:`load`, or a linear model."""
    file = open_robot(path)
    if not file.is_linear_model:
        return file.mechanism(ReadingOptions(**reading))
    from echelon.formats.linear import read_linear

    return read_linear(file.document)
