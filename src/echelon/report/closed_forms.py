"""Closed forms as HTML: XX₃ − YY₃ + YY₄ + 2·d₄·MZ₄ with true subscripts, so that they read as in the literature."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING

from echelon.base.expression import Expression, TextStyle, angle_text, render
from echelon.base.model import BaseModel
from echelon.conventions import PARAMETERS
from echelon.errors import one_line
from echelon.exact.polynomial import is_trigonometric
from echelon.report.page import trusted

if TYPE_CHECKING:
    from markupsafe import Markup

_LONG = 72  # characters of a closed form that are shown at once
_GROUPS = 3  # shown of one that is longer


class HtmlStyle(TextStyle):
    """HTML whose names are escaped."""

    def __init__(self, labels: dict[str, tuple[str, str]]) -> None:
        self._labels = labels

    def parameter(self, name: str) -> str:
        """E.g. ``<i>XX</i><sub>3</sub>``."""
        kind, label = self._labels.get(name) or _split(name)
        return _indexed(kind, label)

    def generator(self, name: str, exponent: int) -> str:
        """A power of a symbol, sine or cosine."""
        power = f"<sup>{exponent}</sup>" if exponent > 1 else ""
        if is_trigonometric(name):
            return f"{escape(name[:3])}{power}({angle_text(name, self, _symbol)})"
        return f"{_symbol(name)}{power}"


def _symbol(name: str) -> str:
    return _indexed(*_split(name))


@dataclass(frozen=True)
class ClosedForm:
    """A base parameter to be shown."""

    html: Markup
    text: str  # as plain text
    start: Markup  # the beginning of a long one; empty if it is short
    terms: int  # standard parameters in it


class ClosedForms:
    """The closed forms of a model."""

    def __init__(self, base: BaseModel) -> None:
        self._base = base

    @cached_property
    def style(self) -> HtmlStyle:
        """How names are written."""
        mechanism = self._base.mechanism
        return HtmlStyle(
            {
                p.name: (PARAMETERS[p.kind], mechanism.bodies[p.body].label)
                for p in mechanism.columns
                if p.kind is not None and p.body is not None
            }
        )

    def name(self, parameter: str) -> Markup:
        """A parameter's name as safe HTML."""
        return trusted(self.style.parameter(parameter))

    def all(self) -> list[ClosedForm]:
        """One per base parameter."""
        return [self._form(expression) for expression in self._base.expressions]

    def _form(self, expression: Expression) -> ClosedForm:
        text = str(expression)
        start = ""
        if len(text) > _LONG and len(expression.groups) > 1:
            start = render(replace(expression, groups=expression.groups[:_GROUPS]), self.style)
            if len(expression.groups) <= _GROUPS:
                start = self.style.parameter(expression.name)
        terms = sum(len(group.parameters) for group in expression.groups)
        return ClosedForm(trusted(render(expression, self.style)), text, trusted(start), terms)


def _split(name: str) -> tuple[str, str]:
    """A name and its index: ``Fv1`` → (Fv, 1), ``d4`` → (d, 4), ``Fc_elbow`` → (Fc, elbow)."""
    found = re.fullmatch(r"([^\W\d_]+)_?(\d\w*)|([^\W\d_]+)_(\w+)", one_line(name))
    if found is None:
        return name, ""
    return found[1] or found[3], found[2] or found[4]


def _indexed(stem: str, index: str) -> str:
    below = f"<sub>{escape(one_line(index).lstrip('_'))}</sub>" if index else ""
    return f"<i>{escape(one_line(stem))}</i>{below}"
