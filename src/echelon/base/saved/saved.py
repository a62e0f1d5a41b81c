"""Sets of base parameters as JSON: saved, read back exactly, and checked again with fresh randomness."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields, replace
from functools import cache
from math import isclose
from typing import TYPE_CHECKING, Any, TypeVar

from echelon.algebra import RationalFunction, parse, random_generator
from echelon.base.ball_checks import check_in_balls
from echelon.base.certificate import Certificate, certify
from echelon.base.derive import model_at_stated_values, silent, specialised
from echelon.base.linear_base import LinearBase, linear_special, stated_texts
from echelon.base.linear_base import model_at_stated_values as linear_at_stated_values
from echelon.base.matrix import BaseMatrix, StatedNumbers, coefficient_value
from echelon.base.model import BaseModel
from echelon.base.stated_values import SpecialValues
from echelon.base.structure import find_structure
from echelon.dynamics import virtual_power_form
from echelon.formats import ReadingOptions, linear_document
from echelon.robot import all_symbols, value_texts
from echelon.shared import (
    CertificateError,
    EchelonError,
    InputError,
    __version__,
    parse_json,
    public,
    read_content,
    record_data,
    record_from,
    write_atomically,
)

if TYPE_CHECKING:
    from echelon.base.saved.schema import (
        BaseModelRecord,
        BaseParameterRecord,
        LinearBaseRecord,
    )


LINEAR_SCHEMA = "echelon.linear-base/1"

Saved = TypeVar("Saved", BaseModel, LinearBase, BaseModel | LinearBase)


def to_json(model: BaseModel | LinearBase) -> str:
    """The model as JSON text; equal models give equal text."""
    document = to_dict(model) if isinstance(model, BaseModel) else linear_to_dict(model)
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def to_dict(model: BaseModel) -> dict[str, Any]:
    """The model as JSON-able data."""
    from echelon.base.saved.schema import SCHEMA_NAME, BaseModelRecord
    from echelon.formats import write_description

    mechanism = model.mechanism
    document = record_data(
        BaseModelRecord,
        model,
        schema=SCHEMA_NAME,
        echelon=__version__,
        name=mechanism.name,
        outputs=[output.name for output in mechanism.outputs],
        order=[model.parameters[c] for c in model.matrix.order],
        numbers=_numbers(model),
        reading=asdict(model.reading),
        model=write_description(mechanism, elementary=True),
        **_set(model, _stated(model)),
    )
    return (
        document
        if document["numbers"]
        else {key: value for key, value in document.items() if key != "numbers"}
    )


def linear_to_dict(base: LinearBase) -> dict[str, Any]:
    """A linear model's set as JSON-able data; ``model`` is a document that :func:`echelon.load_linear` reads."""
    document = {
        "schema": LINEAR_SCHEMA,
        "echelon": __version__,
        "name": base.model.name,
        "seed": base.seed,
        "rank": base.rank,
        "outputs": list(base.model.outputs),
        "order": [base.parameters[c] for c in base.matrix.order],
        "generic": base.generic,
        "numbers": _numbers(base),
        **_set(base, base.model.values),
        "model": linear_document(base.model),
    }
    return (
        document
        if document["numbers"]
        else {key: value for key, value in document.items() if key != "numbers"}
    )


def _set(model: BaseModel | LinearBase, known: Mapping[str, float]) -> dict[str, Any]:
    """Fields that both kinds of saved sets share; ``known`` are values of symbols."""
    evidence = model.certificate
    return {
        "parameters": list(model.parameters),
        "base": _base_rows(model, known),
        "classification": _classes(model),
        "special": model.special and asdict(model.special),
        "certificate": {
            **asdict(evidence),
            "identity_primes": [str(p) for p in evidence.identity_primes],
        },
    }


def _stated(model: BaseModel) -> dict[str, float]:
    return {
        name: s.value
        for name, s in model.mechanism.symbols.items()
        if s.value is not None
    }


def _numbers(model: BaseModel | LinearBase) -> dict[str, Any] | None:
    """The columns of B that are numbers, if there are any."""
    numbers = model.matrix.numbers
    if numbers is None:
        return None
    return {
        "parameters": [model.parameters[c] for c in numbers.columns],
        "at": dict(numbers.at),
        "radius": numbers.radius,
        "rounded": numbers.rounded,
    }


def _classes(model: BaseModel | LinearBase) -> dict[str, list[str]]:
    classes: dict[str, list[str]] = {}
    for name, kind in model.classification.items():
        classes.setdefault(kind.value, []).append(name)
    return classes


def _base_rows(
    model: BaseModel | LinearBase, known: Mapping[str, float]
) -> list[dict[str, Any]]:
    rows = []
    for expression, row in zip(model.expressions, model.matrix.rows, strict=True):
        terms = [
            _term(model.parameters[column], c, known)
            for column, c in sorted(row.items())
        ]
        rows.append(
            {
                "name": expression.name,
                "unit": expression.unit,
                "expression": str(expression),
                "terms": terms,
            }
        )
    return rows


def _term(
    parameter: str, coefficient: RationalFunction, known: Mapping[str, float]
) -> dict[str, Any]:
    term: dict[str, Any] = {
        "parameter": parameter,
        "coefficient": str(coefficient.numerator),
    }
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
    document = parse_json(text, source)
    if _is_linear(document):
        raise InputError(
            "this is the set of a linear model: read it with load_linear_base",
            source=source,
        )
    return _from_document(document, source)


def linear_from_json(text: str | bytes, source: str = "base model") -> LinearBase:
    """Read the set of a linear model back; its claim is not checked: use :func:`echelon.verify`."""
    document = parse_json(text, source)
    if not _is_linear(document):
        raise InputError(
            "this is not the set of a linear model; read one of a robot with load_base",
            source=source,
        )
    return _linear_from_document(document, source)


def _is_linear(document: Any) -> bool:
    """Whether a document says that it holds the set of a linear model."""
    return isinstance(document, dict) and document.get("schema") == LINEAR_SCHEMA


def _linear_from_document(document: Any, source: str) -> LinearBase:
    from echelon.base.saved.schema import LinearBaseRecord
    from echelon.formats import Document, read_linear

    record = record_from(
        LinearBaseRecord, document, source, "a saved set of a linear model"
    )
    model = read_linear(Document(record.model, source))
    matrix = _matrix(record, model.parameters, source)
    certificate = Certificate(**record.certificate.model_dump())
    found = LinearBase(
        model, matrix, certificate, record.seed, record.special, record.generic
    )
    if matrix.numbers and matrix.numbers.at != stated_texts(model):
        raise CertificateError(
            "'numbers' are for other values than those stated by the model"
        )
    _check_derived(record, found, model.name, model.outputs)
    return found


def _from_document(document: Any, source: str) -> BaseModel:
    from echelon.base.saved.schema import BaseModelRecord

    return _from_record(
        record_from(BaseModelRecord, document, source, "a saved base model"), source
    )


def _from_record(record: BaseModelRecord, source: str) -> BaseModel:
    from echelon.formats import RobotFile

    data = json.dumps(record.model).encode()
    exactly = ReadingOptions(keep_fixed_links=True, snap_tolerance=0)
    mechanism = RobotFile(data, source, is_description=True).mechanism(exactly)
    matrix = _matrix(record, mechanism.parameters, source)
    certificate = Certificate(**record.certificate.model_dump())
    model = BaseModel(
        mechanism,
        matrix,
        certificate,
        record.reading,
        record.seed,
        record.special,
        record.generic,
    )
    _check_derived(
        record, model, mechanism.name, [output.name for output in mechanism.outputs]
    )
    if matrix.numbers and matrix.numbers.at != value_texts(
        mechanism, all_symbols(mechanism)
    ):
        raise CertificateError(
            "'numbers' are for other values than those stated by the model"
        )
    return model


def _matrix(
    record: BaseModelRecord | LinearBaseRecord, parameters: Sequence[str], source: str
) -> BaseMatrix:
    """B as it is recorded."""
    if list(parameters) != record.parameters:
        raise InputError(
            "the parameters are not those of the model",
            source=source,
            element="parameters",
        )
    column = {name: i for i, name in enumerate(record.parameters)}
    stated = record.numbers
    numbers = None
    try:
        read = cache(lambda above, below: RationalFunction(parse(above), parse(below)))
        rows = tuple(_row(row, column, read) for row in record.base)
        pivots = tuple(column[row.name] for row in record.base)
        order = tuple(column[name] for name in record.order)
        if stated is not None:
            numbers = StatedNumbers(
                tuple(column[name] for name in stated.parameters),
                stated.at,
                stated.radius,
                stated.rounded,
            )
    except KeyError as error:
        raise InputError(
            f"unknown parameter {error}", source=source, element="base"
        ) from None
    except (ValueError, ZeroDivisionError) as error:
        raise InputError(
            f"unreadable coefficient: {error}", source=source, element="base"
        ) from None
    return BaseMatrix(tuple(parameters), pivots, rows, order, numbers)


def _row(
    record: BaseParameterRecord,
    column: Mapping[str, int],
    read: Callable[[str, str], RationalFunction],
) -> dict[int, RationalFunction]:
    row = {
        column[t.parameter]: read(t.coefficient, t.denominator) for t in record.terms
    }
    if not all(row.values()):
        raise CertificateError(f"a coefficient in {record.name} is zero")
    if len(row) < len(record.terms):
        raise ValueError(f"a parameter occurs twice in {record.name}")
    return row


def _check_derived(
    record: BaseModelRecord | LinearBaseRecord,
    model: BaseModel | LinearBase,
    name: str,
    outputs: Sequence[str],
) -> None:
    """Check that the values for people and other programs follow from the exact terms."""
    stated = (record.name, record.rank, record.outputs, record.classification)
    true = (name, model.rank, list(outputs), _classes(model))
    for key, mine, theirs in zip(
        ("name", "rank", "outputs", "classification"), true, stated, strict=True
    ):
        if mine != theirs:
            raise CertificateError(
                f"'{key}' contradicts the model or the terms of its base parameters"
            )
    special = model.special
    if special and model.rank != (
        special.generic_rank if model.generic else special.rank
    ):
        raise CertificateError(
            f"'special' has another rank than the set's {model.rank}"
        )
    known = _stated(model) if isinstance(model, BaseModel) else model.model.values
    largest = getattr(record, "largest_coefficient", None)
    if isinstance(model, BaseModel) and not _same(largest, model.largest_coefficient):
        raise CertificateError(
            "'largest_coefficient' contradicts the terms of the base parameters"
        )
    for row, derived in zip(record.base, _base_rows(model, known), strict=True):
        shown = {t.parameter: t.value for t in row.terms}
        true_values = {term["parameter"]: term["value"] for term in derived["terms"]}
        same_text = (
            row.expression == derived["expression"]
        )  # whatever version wrote it: people read nothing else
        if (
            row.unit != derived["unit"]
            or not same_text
            or not _same_values(shown, true_values)
        ):
            raise CertificateError(
                f"unit, expression or values of {row.name} contradict its terms"
            )


def _same_values(
    stated: Mapping[str, float | None], derived: Mapping[str, float | None]
) -> bool:
    return stated.keys() == derived.keys() and all(
        _same(stated[name], derived[name]) for name in stated
    )


def _same(a: float | None, b: float | None) -> bool:
    return (
        a is b if a is None or b is None else isclose(a, b, rel_tol=1e-9, abs_tol=1e-12)
    )


@public
def save_base(model: BaseModel | LinearBase, path: str | os.PathLike[str]) -> None:
    """Write a model to a JSON file, whole or not at all.

    Parameters
    ----------
    model : BaseModel or LinearBase
    path : path-like

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    write_atomically(path, to_json(model))


@public
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
    return _read(path, from_json)


@public
def load_linear_base(path: str | os.PathLike[str]) -> LinearBase:
    """Read the set of a linear model from a JSON file.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    LinearBase

    Raises
    ------
    InputError
        If the file cannot be read or is not a saved set of a linear model.
    CertificateError
        If counts, expressions, values or classes do not follow from the exact terms.
    """
    return _read(path, linear_from_json)


def load_set(path: str | os.PathLike[str]) -> BaseModel | LinearBase:
    """Read a saved set of a robot or of a linear model."""

    def either(text: str | bytes, source: str) -> BaseModel | LinearBase:
        document = parse_json(text, source)
        return (
            _linear_from_document(document, source)
            if _is_linear(document)
            else _from_document(document, source)
        )

    return _read(path, either)


def _read(
    path: str | os.PathLike[str], reader: Callable[[str | bytes, str], Saved]
) -> Saved:
    data = read_content(path)
    try:
        return reader(data, str(path))
    except CertificateError:
        raise
    except InputError as error:
        raise error.located(str(path)) from None
    except EchelonError as error:
        raise InputError(str(error), source=str(path)) from None


SEED_BITS = 128
"""Size of a fresh seed, which nobody guesses who makes up a set."""
SAME_LOGARITHM = 1e-6
"""Difference of logarithms of probabilities, whose sums may round differently on another machine."""


@public
def verify(
    model: BaseModel | LinearBase | str | os.PathLike[str],
    seed: int | None = None,
    progress: Callable[[str], None] = silent,
) -> Certificate:
    """Check completeness and minimality of a set, without trusting its own statements.

    The recorded evidence must be what its seed gives.  Then the check is repeated at points modulo primes, or at closed
    states of loops, that whoever made the file cannot know: they come from the operating system's entropy.  (Of linear
    models, which are saved as formulas, only the second is done.)

    Parameters
    ----------
    model : BaseModel, LinearBase or path-like
        A model, or a JSON file written by :func:`echelon.save_base` or ``echelon derive --format json``.
    seed : int, optional
        Seed of the fresh points, to repeat a verification: that of its certificate.
    progress : callable
        Called with the step that starts, as text.

    Returns
    -------
    Certificate
        The fresh evidence, with its seed.  The set is valid as a whole only if its ``unchecked`` is empty.

    Raises
    ------
    CertificateError
        If the set is not complete and minimal, or the recorded evidence does not belong to it.
    InputError
        If the file cannot be read.
    """
    if isinstance(model, str | os.PathLike):
        progress("reading the set")
        model = load_set(model)
    recorded = model.certificate
    if recorded.rank != model.rank:
        raise CertificateError(
            f"the certificate is for {recorded.rank} base parameters, the set has {model.rank}"
        )
    if recorded.seed != model.seed:
        raise CertificateError(
            f"the certificate has the seed {recorded.seed}, the set {model.seed}"
        )
    fresh = secrets.randbits(SEED_BITS) if seed is None else seed
    if isinstance(model, LinearBase):
        progress("checking every column at new points")
        if model.generic:
            _check_special(
                model,
                linear_special(
                    model.model, model.matrix.order, random_generator(fresh)
                ),
            )
        at_constants = None if model.generic else linear_at_stated_values(model.model)
        return certify(model.model.regressor, model.matrix, fresh, at_constants)
    doubts, singular = list[str](), ""
    forms = virtual_power_form(model.mechanism)
    at_values = model_at_stated_values(model.mechanism, forms)
    if model.generic:
        progress("structure at the stated values")
        found = specialised(
            model.mechanism, random_generator(fresh), at_values, generic=True
        )
        _check_special(model, found.special)
        if found.undecided:
            doubts.append(f"the number at the stated values ({found.undecided})")
    if forms.loops is not None:
        progress("structure")
        structure = find_structure(
            model.mechanism, random_generator(recorded.seed), generic=False
        )
        singular = structure.where_modes_meet
        if structure.doubt and not singular:
            doubts.append(structure.doubt)
    stated = None if model.generic else at_values
    progress("repeating the recorded check")
    _compare(recorded, certify(forms, model.matrix, recorded.seed, stated, singular))
    progress("checking every column at new points")
    certificate = certify(forms, model.matrix, fresh, stated, singular)
    if stated is not None and stated.approximate and forms.loops is None:
        progress("minor at rounded values")
        try:
            check_in_balls(
                forms, model.matrix, (), stated.texts, random_generator(fresh)
            )
        except CertificateError as error:
            doubts.append(
                f"independence at the rounded values of {', '.join(stated.approximate)} ({error})"
            )
        else:
            certificate = replace(certificate, at_values=True)
    return replace(certificate, unchecked=(*certificate.unchecked, *doubts))


def _check_special(model: BaseModel | LinearBase, found: SpecialValues | None) -> None:
    """Refuse a set for general values that does not say what the stated values change."""
    if model.special == found:
        return
    if found is None:
        raise CertificateError(
            "'special' claims that the stated values change the answer, but they do not"
        )
    relations = ", ".join(found.relations)
    raise CertificateError(
        f"the set hides that the stated values of the symbols leave only {found.rank} base parameters, because "
        f"{relations}"
    )


def _compare(recorded: Certificate, repeated: Certificate) -> None:
    """Refuse evidence that is not what its own seed gives."""
    for field in fields(Certificate):
        stated, found = getattr(recorded, field.name), getattr(repeated, field.name)
        same = (
            isclose(stated, found, abs_tol=SAME_LOGARITHM)
            if isinstance(stated, float) and found is not None
            else stated == found
        )
        if not same:
            raise CertificateError(
                f"the recorded {field.name} {stated} is not what its seed gives: {found}"
            )
