"""Linear models as documents: variables, parameters, constants, and outputs or a regressor.

A document says ``echelon: 1`` and ``model: linear``; see ``docs/linear-models.md``.
"""

from __future__ import annotations

import os
from typing import Any, Literal

from pydantic import BaseModel as Schema
from pydantic import ConfigDict, Field, ValidationError, model_validator

from echelon.algebra import to_sympy
from echelon.dynamics import LinearModel
from echelon.formats.description.document import Document, read_text
from echelon.shared import extra, locating, public, read_content


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
    except ValidationError as error:
        first = error.errors()[0]
        path = ".".join(
            str(part)
            for part in first["loc"]
            if part not in ("list[str]", "dict[str,nullable[str]]")
        )
        raise document.error(path, first["msg"]) from None
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


class LinearDocument(Schema):
    """A model that is linear in its parameters."""

    model_config = ConfigDict(extra="forbid", frozen=True, coerce_numbers_to_str=True)

    echelon: Literal["1"] = Field(description="Version of the format.")
    model: Literal["linear"]
    name: str = "model"
    variables: list[str] = Field(description="What varies from sample to sample.")
    parameters: dict[str, str | None] | list[str] = Field(
        description="Names, or names with units, in column order."
    )
    constants: dict[str, str | None] | list[str] = Field(
        {}, description="Names, or names with exact values."
    )
    outputs: dict[str, str] | None = Field(
        None, description="Expressions linear in the parameters, by name."
    )
    regressor: dict[str, list[str]] | None = Field(
        None, description="Rows of X by the name of their output."
    )

    @model_validator(mode="after")
    def _one_of_two(self) -> LinearDocument:
        if (self.outputs is None) == (self.regressor is None):
            raise ValueError("give either outputs or regressor")
        return self


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
