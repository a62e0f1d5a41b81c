"""The document of a linear model as a data model."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel as Schema
from pydantic import ConfigDict, Field, model_validator


class LinearDocument(Schema):
    """A model that is linear in its parameters."""

    model_config = ConfigDict(extra="forbid", frozen=True, coerce_numbers_to_str=True)

    echelon: Literal["1"] = Field(description="Version of the format.")
    model: Literal["linear"]
    name: str = "model"
    variables: list[str] = Field(description="What varies from sample to sample.")
    parameters: dict[str, str | None] | list[str] = Field(description="Names, or names with units, in column order.")
    constants: dict[str, str | None] | list[str] = Field({}, description="Names, or names with exact values.")
    outputs: dict[str, str] | None = Field(None, description="Expressions linear in the parameters, by name.")
    regressor: dict[str, list[str]] | None = Field(None, description="Rows of X by the name of their output.")

    @model_validator(mode="after")
    def _one_of_two(self) -> LinearDocument:
        if (self.outputs is None) == (self.regressor is None):
            raise ValueError("give either outputs or regressor")
        return self
