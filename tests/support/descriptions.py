"""Descriptions that tests write as text."""

from __future__ import annotations

from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from echelon.robot.mechanism import Mechanism


def read_description(
    text: str | bytes, source: str, options: ReadingOptions
) -> Mechanism:
    """The robot that the text of a description states."""
    data = text.encode() if isinstance(text, str) else text
    return RobotFile(data, source, is_description=True).mechanism(options)
