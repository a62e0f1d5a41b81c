"""Echelon's own description format: read a robot from YAML or JSON, and write any mechanism exactly.

The format is specified by :mod:`echelon.formats.schema` and explained in ``docs/formats/description.md``.  Its
expressions are exact already, so a mechanism is built from it directly, without the literal tree of other formats.
"""

from __future__ import annotations

from echelon.formats.description_write import write_description
from echelon.formats.options import ReadingOptions
from echelon.formats.robot_file import RobotFile
from echelon.mechanism.mechanism import Mechanism

__all__ = ["read_description", "write_description"]


def read_description(text: str | bytes, source: str, options: ReadingOptions) -> Mechanism:
    """Read a robot from the text of a description.

    >>> pendulum = '''
    ... echelon: 1
    ... name: pendulum
    ... symbols: {l1: 0.5}
    ... gravity: [0, -9.81, 0]
    ... modified_dh:
    ...   - {joint: revolute}
    ...   - {joint: revolute, a: l1}
    ... '''
    >>> print(read_description(pendulum, "pendulum.yaml", ReadingOptions()))
    pendulum: 2 bodies, 2 degrees of freedom
    """
    data = text.encode() if isinstance(text, str) else text
    return RobotFile(data, source, is_description=True).mechanism(options)
