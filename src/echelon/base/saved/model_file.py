"""Files that hold a robot, a linear model or a saved set of base parameters, told apart by their content."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from echelon.base.linear_base import LinearBase
from echelon.base.model import BaseModel
from echelon.dynamics import LinearModel
from echelon.formats import load_model as read_model
from echelon.robot import Mechanism
from echelon.shared import InputError, public

HEAD = 4096
"""Bytes at the beginning of a saved set, among which is the name of its schema."""


@public
def load_model(
    source: Any, **reading: Any
) -> Mechanism | LinearModel | BaseModel | LinearBase:
    """Read a robot, a linear model or a saved set of base parameters.

    Every public function that takes one of them takes a path in its place, which is read by this function.

    Parameters
    ----------
    source : path-like, str or model
        Anything that :func:`echelon.load` or :func:`echelon.load_linear` reads, or a file by :func:`echelon.save_base`.
    reading
        Keyword arguments of :func:`echelon.load`, for robots.

    Returns
    -------
    Mechanism, LinearModel, BaseModel or LinearBase

    Raises
    ------
    InputError
        If it cannot be read, or a saved set is to be read with other options than it was made with.

    Examples
    --------
    >>> import echelon as ec
    >>> ec.load_model("examples/linear/arrhenius.yaml")
    LinearModel(Arrhenius: 2 outputs, 9 parameters)
    >>> ec.base_structure("examples/panda.yaml").rank
    43
    """
    from echelon.base.saved.saved import LINEAR_SCHEMA, load_base, load_linear_base

    linear = _says(source, LINEAR_SCHEMA)
    if not linear and not holds_saved_base(source):
        return read_model(source, **reading)
    if reading:
        raise InputError(
            "options for reading do not apply to a saved set",
            source=str(source),
        )
    return load_linear_base(source) if linear else load_base(source)


def holds_saved_base(source: Any) -> bool:
    """Whether a source is a file that says that it holds base parameters of a robot."""
    from echelon.base.saved.schema import SCHEMA_NAME

    return _says(source, SCHEMA_NAME)


def _says(source: Any, schema: str) -> bool:
    """Whether a source is a JSON file with the name of a schema at its beginning."""
    if (
        not isinstance(source, str | os.PathLike)
        or Path(source).suffix.lower() != ".json"
    ):
        return False
    if not os.path.isfile(source):  # of a long text, pathlib raises an OSError
        return False
    with Path(source).open("rb") as stream:
        return f'"{schema}"'.encode() in stream.read(HEAD)
