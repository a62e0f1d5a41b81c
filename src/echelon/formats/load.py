"""Open a robot file of any supported format."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal

from echelon.errors import InputError
from echelon.formats.build import build_mechanism
from echelon.formats.options import ANGLE_TOLERANCE, Gravity, ReadingOptions
from echelon.inputs.content import read_content
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import in_numbers

_SUPPORTED = "URDF (.urdf), SDF (.sdf), MJCF (.xml, .mjcf) or an Echelon description (.yaml, .yml, .json)"
_XACRO = re.compile(r"\{https?://[^}]*xacro/?\}")


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
    file = Path(path)
    mechanism = parse_robot(read_content(file), str(file), options, file.parent)
    return mechanism if symbolic else _in_numbers(mechanism)


def _in_numbers(mechanism: Mechanism) -> Mechanism:
    reading, numeric = mechanism.reading, in_numbers(mechanism)
    return numeric if reading is None else replace(numeric, reading=reading.followed_by(in_numbers))


def parse_robot(data: bytes, source: str, options: ReadingOptions, directory: Path | None = None) -> Mechanism:
    """Interpret the content of a robot file.

    Parameters
    ----------
    data : bytes
    source : str
        File name, for the format and for messages.
    options : ReadingOptions
    directory : Path, optional
        Where files that it includes are looked for.
    """
    suffix = Path(source).suffix.lower()
    if suffix in (".yaml", ".yml", ".json"):
        from echelon.formats.description import read_description

        return read_description(data, source, options, partial(_read_beside, directory or Path()))
    if not data.strip():
        raise InputError("the file is empty", source=source)
    if suffix in (".urdf", ".sdf", ".world", ".xml", ".mjcf", ".xacro") or data.lstrip()[:1] == b"<":
        return _parse_xml_robot(data, source, options, directory)
    raise InputError(f"unknown format; expected {_SUPPORTED}", source=source)


def _read_beside(directory: Path, name: str, options: ReadingOptions) -> Mechanism:
    """The robot file that a description adds to."""
    file = directory / name
    if file.suffix.lower() in (".yaml", ".yml", ".json"):
        raise InputError("only URDF, SDF and MJCF files can be added to; include the description", source=str(file))
    return parse_robot(read_content(file), str(file), options, file.parent)


def _parse_xml_robot(data: bytes, source: str, options: ReadingOptions, directory: Path | None) -> Mechanism:
    from echelon.inputs.xml_text import parse_xml

    root = parse_xml(data, source)
    if any(_XACRO.match(str(element.tag)) for element in root.iter()):
        raise InputError("this is xacro source: expand it first (xacro robot.xacro > robot.urdf)", source=source)
    if root.tag == "mujoco":
        from echelon.formats.mjcf import read_mjcf

        tree = read_mjcf(data, source, directory, mimics=not options.independent_mimics)
    elif root.tag == "robot":
        from echelon.formats.urdf import read_urdf

        tree = read_urdf(data, source, mimics=not options.independent_mimics)
    elif root.tag == "sdf":
        from echelon.formats.sdf import read_sdf

        tree = read_sdf(data, source, mimics=not options.independent_mimics)
    else:
        problem = f"the root element is <{root.tag}>; expected <robot> (URDF), <sdf> (SDF) or <mujoco> (MJCF)"
        raise InputError(problem, source=source)
    mechanism = build_mechanism(tree, options)
    if not tree.has_mimics or mechanism.reading is None:
        return mechanism
    other = replace(options, independent_mimics=not options.independent_mimics)
    recoupled = partial(_parse_xml_robot, data, source, other, directory)
    return replace(mechanism, reading=replace(mechanism.reading, recoupled=recoupled))
