"""The identified robot as files that people simulate and control with.

Who comes with a URDF or MJCF file gets that file back with other numbers in it.  Who comes with a description gets the
description with values, which says everything, and a URDF of its geometry where URDF can say it.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.formats.write_values import IdentifiedValues, sorted_values
from echelon.formats.write_xml import decoded
from echelon.inputs.content import read_content
from echelon.inputs.xml_text import parse_xml
from echelon.mechanism.mechanism import Mechanism

_DESCRIPTIONS = (".yaml", ".yml", ".json")


@dataclass(frozen=True)
class WrittenRobot:
    """A robot file that is yet to be written (see :func:`echelon.files.write_atomically`).

    Attributes
    ----------
    name : str
        ``identified.urdf``, ``identified.xml`` (MJCF) or ``identified.yaml``.
    text : str
    notes : tuple of str
        What the format cannot say, with values, and what was changed beside inertias.
    """

    name: str
    text: str
    notes: tuple[str, ...]


def identified_robot(
    mechanism: Mechanism, standard: npt.ArrayLike, source: str | os.PathLike[str] | None = None
) -> tuple[WrittenRobot, ...]:
    """Write identified standard parameters into the robot's file.

    Parameters
    ----------
    mechanism : Mechanism
    standard : array of shape (p,)
        In the order of ``mechanism.parameters``: ten per body about the origin of the body's frame, of what it carries,
        then those of the effects; SI units.  Bodies that carry all ten must be physically consistent.
    source : path, optional
        The URDF or MJCF file that the mechanism was read from, or that its set-up adds to; none, or a description, to
        write a description.

    Returns
    -------
    tuple of WrittenRobot
        For URDF and MJCF, the file with the identified values.  Otherwise ``identified.yaml``, which says
        everything, and ``identified.urdf`` where URDF can express the geometry.

    Raises
    ------
    InputError
        If no body can have these parameters, or the file cannot be read or is not that of the mechanism.
    MissingExtraError
        For MJCF, if the package ``mujoco`` is not installed.

    Examples
    --------
    >>> import echelon as ec
    >>> robot = ec.load("examples/two_link.xml")
    >>> (written,) = identified_robot(robot, [v or 0.0 for v in robot.standard_values()], "examples/two_link.xml")
    >>> written.name
    'identified.xml'
    >>> 'mass="1.6"' in written.text
    True
    """
    values = sorted_values(mechanism, standard)
    if source is None or Path(source).suffix.lower() in _DESCRIPTIONS:
        return _from_description(mechanism, values)
    file = Path(source)
    text = decoded(read_content(file), str(file))
    root = parse_xml(text, str(file))
    if root.tag == "mujoco":
        from echelon.formats.write_mjcf import edited_mjcf

        return (WrittenRobot("identified.xml", *edited_mjcf(mechanism, values, text, str(file), file.parent)),)
    if root.tag == "robot":
        from echelon.formats.write_urdf_file import edited_urdf

        return (WrittenRobot("identified.urdf", *edited_urdf(mechanism, values, text, str(file))),)
    if root.tag == "sdf":
        return _from_description(mechanism, values)
    problem = f"the root element is <{root.tag}>; expected <robot> (URDF), <sdf> (SDF) or <mujoco> (MJCF)"
    raise InputError(problem, source=str(file))


def _from_description(mechanism: Mechanism, values: IdentifiedValues) -> tuple[WrittenRobot, ...]:
    import yaml

    from echelon.formats.description_write import write_description
    from echelon.formats.write_urdf import generated_urdf, urdf_obstacle

    document = write_description(_with_values(mechanism, values))
    dumped: Any = yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=120, default_flow_style=None)
    obstacle = urdf_obstacle(mechanism, values)
    if obstacle:
        return (
            WrittenRobot("identified.yaml", str(dumped), (f"there is no URDF of this robot beside it: {obstacle}",)),
        )
    return (
        WrittenRobot("identified.yaml", str(dumped), ()),
        WrittenRobot("identified.urdf", *generated_urdf(mechanism, values)),
    )


def _with_values(mechanism: Mechanism, values: IdentifiedValues) -> Mechanism:
    """The mechanism as if its file had stated the identified values."""
    bodies = tuple(
        replace(body, inertial=tuple(float(v) for v in np.asarray(ten)) if body.carried else None)
        for body, ten in zip(mechanism.bodies, values.bodies, strict=True)
    )
    effects = tuple(replace(effect, value=values.effects[effect.parameter]) for effect in mechanism.effects)
    return replace(mechanism, bodies=bodies, effects=effects)
