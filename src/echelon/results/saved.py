"""Save a BaseModel as JSON and read it back, exactly."""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from echelon.base.certificate import Certificate
from echelon.base.matrix import BaseMatrix
from echelon.base.model import BaseModel
from echelon.base.reading_report import ReadingReport
from echelon.errors import EchelonError, InputError
from echelon.exact.expressions import parse
from echelon.exact.polynomial import float_generators
from echelon.exact.rational import RationalFunction
from echelon.files import write_atomically
from echelon.formats.options import ReadingOptions
from echelon.mechanism.reading import Snap
from echelon.version import __version__

if TYPE_CHECKING:
    from echelon.results.record import BaseModelRecord, SnapRecord


def to_json(model: BaseModel) -> str:
    """The model as JSON text; equal models give equal text.

    Parameters
    ----------
    model : BaseModel

    Returns
    -------
    str
        A document of schema ``echelon.base-model/1``.
    """
    return json.dumps(to_dict(model), indent=1, ensure_ascii=False) + "\n"


def to_dict(model: BaseModel) -> dict[str, Any]:
    """The model as JSON-able data."""
    from echelon.formats.description import write_description
    from echelon.results.record import SCHEMA_NAME

    certificate = asdict(model.certificate)
    certificate["identity_primes"] = [str(p) for p in model.certificate.identity_primes]
    classes: dict[str, list[str]] = {}
    for name, kind in model.classification.items():
        classes.setdefault(kind.value, []).append(name)
    return {
        "schema": SCHEMA_NAME,
        "echelon": __version__,
        "name": model.mechanism.name,
        "seed": model.seed,
        "rank": model.rank,
        "outputs": list(model.mechanism.velocities),
        "parameters": list(model.parameters),
        "order": [model.parameters[c] for c in model.matrix.order],
        "base": _base_rows(model),
        "classification": classes,
        "reading": asdict(model.reading),
        "certificate": certificate,
        "model": write_description(model.mechanism),
    }


def _base_rows(model: BaseModel) -> list[dict[str, Any]]:
    known = {name: s.value for name, s in model.mechanism.symbols.items() if s.value is not None}
    rows = []
    for expression, row in zip(model.expressions, model.matrix.rows, strict=True):
        terms = [_term(model.parameters[column], c, known) for column, c in sorted(row.items())]
        rows.append({"name": expression.name, "unit": expression.unit, "expression": str(expression), "terms": terms})
    return rows


def _term(parameter: str, coefficient: RationalFunction, known: dict[str, float]) -> dict[str, Any]:
    term: dict[str, Any] = {"parameter": parameter, "coefficient": str(coefficient.numerator)}
    if not coefficient.is_polynomial:
        term["denominator"] = str(coefficient.denominator)
    term["value"] = None
    if all(s in known for s in coefficient.symbols()):
        generators = {*coefficient.numerator.generators(), *coefficient.denominator.generators()}
        term["value"] = coefficient.evaluate(float_generators(generators, known), float)
    return term


def from_json(text: str | bytes, source: str = "base model") -> BaseModel:
    """Read a model back.

    The structure of the document is checked, its claim is not: use :func:`echelon.verify` for that.

    Raises
    ------
    InputError
        If the text is not a document of the schema; names the element.
    """
    from pydantic import ValidationError

    from echelon.results.record import BaseModelRecord

    try:
        record = BaseModelRecord.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(f"not a saved base model: {first['msg']}", source=source, element=where or None) from None
    return _from_record(record, source)


def _from_record(record: BaseModelRecord, source: str) -> BaseModel:
    from echelon.formats.description import read_description

    data = json.dumps(record.model).encode()
    mechanism = read_description(data, source, ReadingOptions(every_link=True))
    if list(mechanism.parameters) != record.parameters:
        raise InputError("the parameters are not those of the model", source=source, element="parameters")
    column = {name: i for i, name in enumerate(record.parameters)}
    try:
        rows = tuple(
            {column[t.parameter]: RationalFunction(parse(t.coefficient), parse(t.denominator)) for t in row.terms}
            for row in record.base
        )
        pivots = tuple(column[row.name] for row in record.base)
        order = tuple(column[name] for name in record.order)
    except KeyError as error:
        raise InputError(f"unknown parameter {error}", source=source, element="base") from None
    except (ValueError, ZeroDivisionError) as error:
        raise InputError(f"unreadable coefficient: {error}", source=source, element="base") from None
    evidence = record.certificate.model_dump()
    try:
        evidence["identity_primes"] = tuple(int(p) for p in evidence["identity_primes"])
    except ValueError:
        raise InputError("primes are decimal numbers", source=source, element="certificate") from None
    return BaseModel(
        mechanism,
        BaseMatrix(mechanism.parameters, pivots, rows, order),
        Certificate(**evidence),
        ReadingReport(
            tuple(_snap(s) for s in record.reading.snaps),
            tuple(record.reading.notes),
            record.reading.literal_rank,
            tuple(_snap(s) for s in record.reading.decisive),
        ),
        record.seed,
    )


def _snap(record: SnapRecord) -> Snap:
    return Snap(record.element, record.literal, record.intended, record.difference)


def save_base(model: BaseModel, path: str | os.PathLike[str]) -> None:
    """Write a model to a JSON file, whole or not at all.

    Parameters
    ----------
    model : BaseModel
    path : path-like

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    write_atomically(path, to_json(model))


def load_base(path: str | os.PathLike[str]) -> BaseModel:
    """Read a model from a JSON file.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    BaseModel

    Raises
    ------
    InputError
        If the file cannot be read or is not a saved base model.
    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", source=str(path)) from None
    try:
        return from_json(data, str(path))
    except InputError:
        raise
    except EchelonError as error:
        raise InputError(str(error), source=str(path)) from None
