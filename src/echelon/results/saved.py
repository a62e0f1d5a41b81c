"""Sets of base parameters as JSON: saved, read back exactly, and checked again with fresh randomness."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Mapping
from dataclasses import asdict, fields
from math import isclose
from typing import TYPE_CHECKING, Any

import numpy as np

from echelon.base.certificate import Certificate, certify
from echelon.base.derive import model_at_stated_values
from echelon.base.linear_base import LinearBase
from echelon.base.matrix import BaseMatrix, StatedNumbers, coefficient_value
from echelon.base.model import BaseModel
from echelon.base.structure import find_structure
from echelon.errors import CertificateError, EchelonError, InputError
from echelon.exact.expressions import parse
from echelon.exact.rational import RationalFunction
from echelon.files import write_atomically
from echelon.formats.linear_document import linear_document
from echelon.formats.snapping import ReadingOptions
from echelon.inputs import parse_json, read_content
from echelon.mechanism.stated import value_texts
from echelon.regressor.linear_forms import virtual_power_form
from echelon.version import __version__

if TYPE_CHECKING:
    from echelon.results.schema import BaseModelRecord, BaseParameterRecord


LINEAR_SCHEMA = "echelon.linear-base/1"


def to_json(model: BaseModel | LinearBase) -> str:
    """The model as JSON text; equal models give equal text."""
    document = to_dict(model) if isinstance(model, BaseModel) else linear_to_dict(model)
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def to_dict(model: BaseModel) -> dict[str, Any]:
    """The model as JSON-able data."""
    from echelon.formats.writers.description_writer import write_description
    from echelon.results.schema import SCHEMA_NAME, BaseModelRecord, record_of

    mechanism = model.mechanism
    document = record_of(
        BaseModelRecord,
        model,
        format=SCHEMA_NAME,
        echelon=__version__,
        name=mechanism.name,
        outputs=[output.name for output in mechanism.outputs],
        order=[model.parameters[c] for c in model.matrix.order],
        numbers=_numbers(model),
        reading=asdict(model.reading),
        model=write_description(mechanism, elementary=True),
        **_set(model, _stated(model)),
    )
    return document if document["numbers"] else {key: value for key, value in document.items() if key != "numbers"}


def linear_to_dict(base: LinearBase) -> dict[str, Any]:
    """A linear model's set as JSON-able data; ``model`` is a document that :func:`echelon.load_linear` reads."""
    return {
        "schema": LINEAR_SCHEMA,
        "echelon": __version__,
        "name": base.model.name,
        "seed": base.seed,
        "rank": base.rank,
        "definitions": dict(base.definitions),
        **_set(base, base.model.values),
        "model": linear_document(base.model),
    }


def _set(model: BaseModel | LinearBase, known: Mapping[str, float]) -> dict[str, Any]:
    """What both kinds of sets save in one form; ``known`` are values of symbols."""
    evidence = model.certificate
    return {
        "parameters": list(model.parameters),
        "base": _base_rows(model, known),
        "classification": _classes(model),
        "special": model.special and asdict(model.special),
        "certificate": {**asdict(evidence), "identity_primes": [str(p) for p in evidence.identity_primes]},
    }


def _stated(model: BaseModel) -> dict[str, float]:
    return {name: s.value for name, s in model.mechanism.symbols.items() if s.value is not None}


def _numbers(model: BaseModel) -> dict[str, Any] | None:
    """The columns of B that are numbers, if there are any."""
    numbers = model.matrix.numbers
    if numbers is None:
        return None
    return {
        "parameters": [model.parameters[c] for c in numbers.columns],
        "at": dict(numbers.at),
        "radius": numbers.radius,
    }


def _classes(model: BaseModel | LinearBase) -> dict[str, list[str]]:
    classes: dict[str, list[str]] = {}
    for name, kind in model.classification.items():
        classes.setdefault(kind.value, []).append(name)
    return classes


def _base_rows(model: BaseModel | LinearBase, known: Mapping[str, float]) -> list[dict[str, Any]]:
    rows = []
    for expression, row in zip(model.expressions, model.matrix.rows, strict=True):
        terms = [_term(model.parameters[column], c, known) for column, c in sorted(row.items())]
        rows.append({"name": expression.name, "unit": expression.unit, "expression": str(expression), "terms": terms})
    return rows


def _term(parameter: str, coefficient: RationalFunction, known: Mapping[str, float]) -> dict[str, Any]:
    term: dict[str, Any] = {"parameter": parameter, "coefficient": str(coefficient.numerator)}
    if not coefficient.is_polynomial:
        term["denominator"] = str(coefficient.denominator)
    term["value"] = None
    if all(s in known for s in coefficient.symbols()):
        term["value"] = coefficient_value(coefficient, known)
    return term


def from_json(text: str | bytes, source: str = "base model") -> BaseModel:
    """Read a model back.

    The document must be of the schema and agree with itself; its claim is not checked: use :func:`echelon.verify`.
    """
    from echelon.results.schema import BaseModelRecord, checked

    return _from_record(checked(BaseModelRecord, parse_json(text, source), source, "a saved base model"), source)


def _from_record(record: BaseModelRecord, source: str) -> BaseModel:
    from pydantic import ValidationError

    from echelon.formats.robot_file import RobotFile
    from echelon.results.schema import made

    data = json.dumps(record.model).encode()
    mechanism = RobotFile(data, source, is_description=True).mechanism(ReadingOptions(keep_fixed_links=True))
    if list(mechanism.parameters) != record.parameters:
        raise InputError("the parameters are not those of the model", source=source, element="parameters")
    column = {name: i for i, name in enumerate(record.parameters)}
    try:
        rows = tuple(_row(row, column) for row in record.base)
        pivots = tuple(column[row.name] for row in record.base)
        order = tuple(column[name] for name in record.order)
        numbers = None
        if (stated := record.numbers) is not None:
            numbers = StatedNumbers(tuple(column[name] for name in stated.parameters), stated.at, stated.radius)
    except KeyError as error:
        raise InputError(f"unknown parameter {error}", source=source, element="base") from None
    except (ValueError, ZeroDivisionError) as error:
        raise InputError(f"unreadable coefficient: {error}", source=source, element="base") from None
    try:
        certificate = made(Certificate, record.certificate)
    except ValidationError:
        raise InputError("primes are decimal numbers", source=source, element="certificate") from None
    matrix = BaseMatrix(mechanism.parameters, pivots, rows, order, numbers)
    model = BaseModel(mechanism, matrix, certificate, record.reading, record.seed, record.special, record.generic)
    _check_derived(record, model)
    return model


def _row(record: BaseParameterRecord, column: Mapping[str, int]) -> dict[int, RationalFunction]:
    row = {column[t.parameter]: RationalFunction(parse(t.coefficient), parse(t.denominator)) for t in record.terms}
    if not all(row.values()):
        raise CertificateError(f"a coefficient in {record.name} is zero")
    if len(row) < len(record.terms):
        raise ValueError(f"a parameter occurs twice in {record.name}")
    return row


def _check_derived(record: BaseModelRecord, model: BaseModel) -> None:
    """What people and other programs read instead of the exact terms must follow from them."""
    stated = (record.name, record.rank, record.outputs, record.classification)
    true = (model.mechanism.name, model.rank, [output.name for output in model.mechanism.outputs], _classes(model))
    for key, mine, theirs in zip(("name", "rank", "outputs", "classification"), true, stated, strict=True):
        if mine != theirs:
            raise CertificateError(f"'{key}' contradicts the model or the terms of its base parameters")
    special = model.special
    if special and model.rank != (special.generic_rank if model.generic else special.rank):
        raise CertificateError(f"'special' is about another rank than the {model.rank} of the set")
    if model.matrix.numbers and model.matrix.numbers.at != value_texts(model.mechanism, model.matrix.numbers.at):
        raise CertificateError("'numbers' are for other values than those stated by the model")
    for row, derived in zip(record.base, _base_rows(model, _stated(model)), strict=True):
        shown = {t.parameter: t.value for t in row.terms}
        true_values = {term["parameter"]: term["value"] for term in derived["terms"]}
        same_text = row.expression == derived["expression"]  # whatever version wrote it: people read nothing else
        if row.unit != derived["unit"] or not same_text or not _same_values(shown, true_values):
            raise CertificateError(f"unit, expression or values of {row.name} contradict its terms")


def _same_values(stated: Mapping[str, float | None], derived: Mapping[str, float | None]) -> bool:
    def same(a: float | None, b: float | None) -> bool:
        return a is b if a is None or b is None else isclose(a, b, rel_tol=1e-9, abs_tol=1e-12)

    return stated.keys() == derived.keys() and all(same(stated[name], derived[name]) for name in stated)


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
    CertificateError
        If counts, expressions, values or classes do not follow from the exact terms.
    """
    data = read_content(path)
    try:
        return from_json(data, str(path))
    except CertificateError:
        raise
    except InputError as error:
        raise error.located(str(path)) from None
    except EchelonError as error:
        raise InputError(str(error), source=str(path)) from None


_SEED_BITS = 128
_SAME = 1e-6  # logarithms; sums of them may round differently elsewhere


def verify(model: BaseModel | str | os.PathLike[str], seed: int | None = None) -> Certificate:
    """Check completeness and minimality of a set, without trusting anything it says about itself.

    The recorded evidence must be what its seed gives.  Then the check is repeated at points modulo primes that whoever
    made the file cannot know: they come from the operating system's entropy.

    Parameters
    ----------
    model : BaseModel or path-like
        A model, or a JSON file written by :func:`echelon.save_base` or ``echelon derive --format json``.
    seed : int, optional
        Seed of the fresh points, to repeat a verification: that of its certificate.

    Returns
    -------
    Certificate
        The fresh evidence, with its seed.

    Raises
    ------
    CertificateError
        If the set is not complete and minimal, or the recorded evidence does not belong to it.
    InputError
        If the file cannot be read.
    """
    if not isinstance(model, BaseModel):
        model = load_base(model)
    recorded = model.certificate
    if recorded.rank != model.rank:
        raise CertificateError(f"the certificate is for {recorded.rank} base parameters, the set has {model.rank}")
    if recorded.seed != model.seed:
        raise CertificateError(f"the certificate has the seed {recorded.seed}, the set {model.seed}")
    modes: tuple[int, ...] = ()
    forms = virtual_power_form(model.mechanism)
    if forms.loops is not None:
        structure = find_structure(model.mechanism, np.random.default_rng(recorded.seed))
        forms, modes = structure.on_curves(forms), structure.modes
    stated = None if model.generic else model_at_stated_values(model.mechanism, forms)
    _compare(recorded, certify(forms, model.matrix, recorded.seed, stated, modes))
    return certify(forms, model.matrix, secrets.randbits(_SEED_BITS) if seed is None else seed, stated, modes)


def _compare(recorded: Certificate, repeated: Certificate) -> None:
    """Refuse evidence that is not what its own seed gives."""
    for field in fields(Certificate):
        stated, found = getattr(recorded, field.name), getattr(repeated, field.name)
        same = (
            isclose(stated, found, abs_tol=_SAME)
            if isinstance(stated, float) and found is not None
            else stated == found
        )
        if not same:
            raise CertificateError(f"the recorded {field.name} {stated} is not what its seed gives: {found}")
