"""Robots in the place of which a path may stand: every public function that takes a robot takes its file as well.

Readers are rooms above those that compute, so a path goes to where users read files: the public face of the package.
"""

from __future__ import annotations

import os
from typing import Any

from echelon.robot.mechanism import Mechanism
from echelon.shared import InputError

Readable = str | os.PathLike[str]
"""A path or name of a robot, its text, or a saved set: what :func:`echelon.load_model` reads."""


def mechanism_of(source: Mechanism | Readable) -> Mechanism:
    """A robot, read from its file if it is not there yet.

    Parameters
    ----------
    source : Mechanism or path-like
        A robot; or a robot file or saved set of base parameters, which is read with all defaults.

    Returns
    -------
    Mechanism

    Raises
    ------
    InputError
        If it is neither, or a file that cannot be read or holds no robot.
    """
    if isinstance(source, Mechanism):
        return source
    found = loaded(source)
    mechanism = getattr(found, "mechanism", found)  # a saved set holds its robot
    if not isinstance(mechanism, Mechanism):
        raise InputError(
            f"a robot is needed, not a {type(found).__name__}", source=str(source)
        )
    return mechanism


def loaded(source: Any) -> Any:
    """The model that a path, a name or a text stands for; everything else is refused."""
    import echelon  # the face knows where files are read; this room does not

    return echelon.load_model(source)
