"""Echelon's own description format: read a robot from YAML or JSON, and write any mechanism exactly.

The format is specified by :mod:`echelon.formats.schema` and explained in ``docs/formats/description.md``.  Its
expressions are exact already, so a mechanism is built from it directly, without the literal tree of other formats.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from echelon.errors import InputError
from echelon.formats.description_build import ReadFile, build_description
from echelon.formats.description_check import check_document, read_checked
from echelon.formats.description_text import Document
from echelon.formats.description_write import write_description
from echelon.formats.options import ReadingOptions
from echelon.mechanism.mechanism import Mechanism

if TYPE_CHECKING:
    from echelon.formats.schema import RobotDescription

__all__ = ["read_description", "read_description_data", "write_description"]


def read_description(
    text: str | bytes, source: str, options: ReadingOptions, read_file: ReadFile | None = None
) -> Mechanism:
    """Read a robot from the text of a description.

    Parameters
    ----------
    text : str or bytes
        YAML or JSON.
    source : str
        Name of the file, for messages.
    options : ReadingOptions
        ``independent_mimics`` and ``symbolic`` have no effect: couplings and symbols are as the description states.
    read_file : callable, optional
        Reads the robot file that a description may add to, by its name.

    Returns
    -------
    Mechanism
        With a reading that records every angle taken as exact.

    Raises
    ------
    InputError
        If the description cannot be read; the message names file, element and line.

    Examples
    --------
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
    return _build(*read_checked(text, source), options, read_file)


def read_description_data(data: Mapping[str, Any], source: str, options: ReadingOptions) -> Mechanism:
    """Read a robot from a description that is already parsed, such as :func:`write_description` returns.

    Parameters
    ----------
    data : mapping
        Numbers should be texts or integers; a float stands for its shortest decimal form.
    source : str
        Where the data comes from, for messages.
    options : ReadingOptions

    Returns
    -------
    Mechanism

    Raises
    ------
    InputError
        As for :func:`read_description`.
    """
    document = Document(dict(data), source)
    return _build(document, check_document(document), options)


def _build(
    document: Document, robot: RobotDescription, options: ReadingOptions, read_file: ReadFile | None = None
) -> Mechanism:
    try:
        return build_description(document, robot, options, read_file)
    except InputError as error:
        raise error.located(document.source) from None
