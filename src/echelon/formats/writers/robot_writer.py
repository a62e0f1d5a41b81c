"""The identified robot as files that people simulate and control with.

Who comes with a URDF or MJCF file gets that file back with other numbers in it.  Who comes with a description gets the
description with values, which says everything, and a URDF of its geometry where URDF can say it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from echelon.formats.robot_file import RobotFile
from echelon.formats.writers.identified_values import IdentifiedValues, sorted_values
from echelon.formats.writers.xml_editor import decoded
from echelon.robot import Mechanism


@dataclass(frozen=True)
class WrittenRobot:
    """A robot file that is yet to be written (see :func:`echelon.shared.files.write_atomically`)."""

    name: str  # ``identified.urdf``, ``identified.xml`` (MJCF) or ``identified.yaml``
    text: str
    notes: tuple[
        str, ...
    ]  # what the format cannot say, with values, and what was changed beside inertias
    doubts: tuple[str, ...] = ()  # what makes simulations with the file wrong


def identified_robot(
    mechanism: Mechanism,
    standard: npt.ArrayLike,
    file: RobotFile | None = None,
    remarks: Sequence[str] = (),
) -> tuple[WrittenRobot, ...]:
    """Write identified standard parameters, shape (p,), into the robot's file, with remarks at its head."""
    values = sorted_values(mechanism, standard)
    if file is None or file.is_description or file.root.tag == "sdf":
        return _from_description(mechanism, values, remarks)
    text = decoded(file.data, file.source)
    if file.root.tag == "mujoco":
        from echelon.formats.writers.mjcf_writer import MjcfEditor, NamedModel

        model = NamedModel(text, file.mjcf)
        if not model.is_complete:  # it multiplies or attaches bodies
            return _from_description(mechanism, values, remarks)
        return (
            WrittenRobot(
                "identified.xml",
                *MjcfEditor(mechanism, values, model, file.source).written(remarks),
            ),
        )
    from echelon.formats.writers.urdf_writer import UrdfEditor

    return (
        WrittenRobot(
            "identified.urdf",
            *UrdfEditor(mechanism, values, text, file.source).written(remarks),
        ),
    )


def _from_description(
    mechanism: Mechanism, values: IdentifiedValues, remarks: Sequence[str]
) -> tuple[WrittenRobot, ...]:
    import yaml

    from echelon.formats.writers.description_writer import write_description
    from echelon.formats.writers.urdf_writer import UrdfGenerator, urdf_obstacle

    document = write_description(_with_values(mechanism, values))
    dumped = yaml.safe_dump(
        document,
        sort_keys=False,
        allow_unicode=True,
        width=120,
        default_flow_style=None,
    )
    dumped = "".join(f"# {' '.join(remark.split())}\n" for remark in remarks) + str(
        dumped
    )
    obstacle = urdf_obstacle(mechanism, values)
    if obstacle:
        missing = f"there is no URDF of this robot beside it: {obstacle}"
        return (WrittenRobot("identified.yaml", dumped, (*remarks, missing)),)
    return (
        WrittenRobot("identified.yaml", dumped, tuple(remarks)),
        WrittenRobot(
            "identified.urdf", *UrdfGenerator(mechanism, values).written(remarks)
        ),
    )


def _with_values(mechanism: Mechanism, values: IdentifiedValues) -> Mechanism:
    """The mechanism as if its file had stated the identified values."""
    bodies = []
    for body, ten in zip(mechanism.bodies, values.bodies, strict=True):
        inertial = None
        if body.carried:
            inertial = tuple(np.asarray(ten, dtype=float).tolist())
        bodies.append(replace(body, inertial=inertial))
    effects = tuple(
        replace(effect, value=values.effects[effect.parameter])
        for effect in mechanism.effects
    )
    return replace(mechanism, bodies=tuple(bodies), effects=effects)
