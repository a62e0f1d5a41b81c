"""Linear models as documents: variables, parameters, constants, and outputs or a regressor.

A document says ``echelon: 1`` and ``model: linear``; see ``docs/linear-models.md``.
"""

from __future__ import annotations

import os
from typing import Annotated, Any, Literal

from echelon.algebra import to_sympy
from echelon.dynamics import LinearModel
from echelon.formats.description.document import Document, read_text
from echelon.formats.schema.schema_types import (
    Expression,
    Model,
    Name,
    Version,
    by_form,
    exactly_one,
)
from echelon.shared import (
    Tag,
    UnfitError,
    extra,
    locating,
    optional,
    public,
    read_content,
    required,
)

_Names = Annotated[
    Annotated[dict[str, str | None], Tag("mapping")]
    | Annotated[list[Name], Tag("list")],
    by_form("mapping", "list"),
]


@public
def load_linear(path: str | os.PathLike[str]) -> LinearModel:
    """Read a linear model from a YAML or JSON document.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    LinearModel

    Raises
    ------
    InputError
        If the file cannot be read or is not such a document, or an output is not linear in its parameters.
    """
    return read_linear(read_text(read_content(path), os.fspath(path)))


def read_linear(document: Document) -> LinearModel:
    """A linear model from a parsed document."""
    try:
        stated = LinearDocument.model_validate(document.data)
    except UnfitError as error:
        from echelon.formats.description.explanations import path_of

        path = path_of(document.data, error)
        raise document.error(path, error.problem) from None
    parameters = stated.parameters
    units = (
        [unit or "" for unit in parameters.values()]
        if isinstance(parameters, dict)
        else None
    )
    given = (stated.variables, list(parameters), stated.constants)
    with locating(document.source):
        if stated.outputs is not None:
            rows, names = list(stated.outputs.values()), list(stated.outputs)
            return LinearModel.from_outputs(rows, *given, names, units, stated.name)
        table = stated.regressor or {}
        return LinearModel(
            list(table.values()), *given, list(table), units, stated.name
        )


class LinearDocument(Model):
    """A model that is linear in its parameters."""

    echelon: Version = required("Version of the format.")
    model: Literal["linear"]
    name: str = "model"
    variables: list[Name] = required("What varies from sample to sample.")
    parameters: _Names = required("Names, or names with units, in column order.")
    constants: _Names = optional({}, "Names, or names with exact values.")
    outputs: dict[str, Expression] | None = optional(
        None, "Expressions linear in the parameters, by name."
    )
    regressor: dict[str, list[Expression]] | None = optional(
        None, "Rows of X by the name of their output."
    )

    _one_form = exactly_one("outputs", "regressor")


def linear_document(model: LinearModel) -> dict[str, Any]:
    """The document of a model, with its regressor."""
    forms = model.regressor
    texts = [_text(e) for e in to_sympy(forms.program, list(forms.entries.values()))]
    table = [["0"] * forms.shape[1] for _ in range(forms.shape[0])]
    for (i, j), text in zip(forms.entries, texts, strict=True):
        table[i][j] = text
    return {
        "echelon": "1",
        "model": "linear",
        "name": model.name,
        "variables": list(model.variables),
        "parameters": dict(zip(model.parameters, model.units, strict=True)),
        "constants": {
            n: None if v is None else str(v) for n, v in model.constants.items()
        },
        "regressor": dict(zip(model.outputs, table, strict=True)),
    }


def _text(formula: Any) -> str:
    """A sympy formula in the grammar of :mod:`echelon.algebra.program.text`."""
    with extra("symbolic"):
        import sympy

    return str(formula.subs(sympy.E, sympy.Function("exp")(sympy.Symbol("1")))).replace(
        "Abs(", "abs("
    )
