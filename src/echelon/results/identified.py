"""Identified models as JSON: everything that was found, and enough to use it and to repeat the run."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from echelon.arrays import Floats
from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.files import write_atomically
from echelon.identification.result import Identification
from echelon.identification.rows.plan import Plan
from echelon.inputs.content import read_content
from echelon.inputs.json_text import parse_json
from echelon.logs.columns.column_map import ColumnMap
from echelon.logs.preparation.settings import Preparation
from echelon.results.identified_document import identification_document
from echelon.results.saved import from_json

if TYPE_CHECKING:
    from echelon.results.identified_record import IdentifiedRecord


@dataclass(frozen=True, repr=False)
class IdentifiedModel:
    """A saved model, ready to predict."""

    base: BaseModel
    values: Floats  # shape (r,): base parameters, SI units
    columns: tuple[ColumnMap, ...]
    preparation: Preparation
    document: Mapping[str, Any]  # all that the file says

    @property
    def plan(self) -> Plan:
        """How logs become rows, as when the model was fitted."""
        return Plan(self.base, self.columns, self.preparation)

    def __repr__(self) -> str:
        return f"IdentifiedModel({self.base.mechanism.name}: {self.base.rank} base parameters)"


def save_identification(identification: Identification, path: str | os.PathLike[str]) -> None:
    """Write an identification to a JSON file of schema ``echelon.identified/1``, whole or not at all.

    Parameters
    ----------
    identification : Identification
    path : path-like

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    write_atomically(path, identification_to_json(identification))


def identification_to_json(identification: Identification) -> str:
    """An identification as JSON text; equal runs give equal text."""
    return json.dumps(identification_document(identification), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def load_identified(path: str | os.PathLike[str]) -> IdentifiedModel:
    """Read an identified model.

    Parameters
    ----------
    path : path-like
        Written by :func:`save_identification` or ``echelon identify``.

    Returns
    -------
    IdentifiedModel

    Raises
    ------
    InputError
        If the file cannot be read or is not an identified model; names the element.
    """
    from pydantic import ValidationError

    from echelon.results.identified_record import IdentifiedRecord

    document = parse_json(read_content(path), str(path))
    try:
        record = IdentifiedRecord.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        problem = f"not an identified model: {first['msg']}"
        raise InputError(problem, source=str(path), element=where or None) from None
    return _from_record(record, document, str(path))


def _from_record(record: IdentifiedRecord, document: Mapping[str, Any], source: str) -> IdentifiedModel:
    base = from_json(json.dumps(document["base"]), source)
    names = [expression.name for expression in base.expressions]
    if list(record.values) != names:
        raise InputError("the values are not those of the base parameters", source=source, element="values")
    columns = tuple(entry.made() for entry in record.columns)
    return IdentifiedModel(base, np.array(list(record.values.values())), columns, record.preparation.made(), document)
