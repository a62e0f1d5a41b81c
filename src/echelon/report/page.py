"""Pages that need nothing but themselves: numbers and closed forms as a reader wants them, sections with templates.

The uncertainty of a number gets two significant digits and the value ends at the same decimal place (GUM, 7.2.6), so
that no printed digit suggests knowledge that is not there.  Closed forms read as in the literature, with true
subscripts: XX₃ − YY₃ + YY₄ + 2·d₄·MZ₄.

Everything that comes from a file is escaped, and a name without value is an error.  A page forbids its own requests to
the network, so that it shows the same everywhere and opening it leaves no trace.  Arrays are 32-bit floats in
base 64: seven digits are more than a screen shows, and a third of the size of decimal text.  jinja2 is imported here
only, and only when a page is made.
"""

from __future__ import annotations

import json
import re
from base64 import b64encode
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from html import escape
from math import floor, inf, isfinite, isinf, isnan, log10
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from echelon.algebra import is_trigonometric
from echelon.base import BaseModel, Expression, TextStyle, angle_text
from echelon.base import render as closed_form
from echelon.shared import PARAMETERS, __version__, extra, one_line

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup


_WRITTEN_OUT = range(-4, 7)  # decimal exponents of numbers without a power of ten
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_MISSING = "–"


def significant(value: float, digits: int = 4) -> str:
    """A number with the given number of significant digits.

    >>> significant(0.123456), significant(-12345.6), significant(3.2e-9, 2), significant(float("inf"))
    ('0.1235', '−12346', '3.2×10⁻⁹', '∞')
    """
    special = _special(value)
    if special is not None:
        return special
    exponent = _exponent(value, digits)
    if exponent not in _WRITTEN_OUT:
        return _scientific(value, exponent, digits - 1)
    return _signed(f"{value:.{max(digits - 1 - exponent, 0)}f}")


def with_uncertainty(value: float, std: float) -> tuple[str, str]:
    """A value and its standard deviation, both ending at the second significant digit of the latter.

    >>> with_uncertainty(1.23456789, 0.00123), with_uncertainty(5123.4, 120.0), with_uncertainty(0.3, 0.0)
    (('1.2346', '0.0012'), ('5120', '120'), ('0.3000', '0'))
    """
    if _special(value) is not None or not isfinite(std) or std <= 0:
        return significant(value), significant(std, 2)
    place = 1 - _exponent(
        std, 2
    )  # decimals that remain; negative for tens and hundreds
    exponent = max(_exponent(value, 17) if value else -place, 1 - place)
    if exponent not in _WRITTEN_OUT:
        decimals = max(exponent + place, 0)
        return _scientific(value, exponent, decimals), _scientific(
            std, exponent, decimals
        )
    decimals = max(place, 0)
    return tuple(
        _signed(f"{round(number, place):.{decimals}f}") for number in (value, std)
    )  # type: ignore[return-value]


def to_place(value: float, std: float) -> str:
    """A number that ends where a value with this standard deviation ends, such as an end of its interval."""
    return with_uncertainty(value, std)[0]


def percent(value: float) -> str:
    """A number of per cent, without the sign; large ones are only said to be large.

    >>> percent(0.5123), percent(12.3), percent(4321.0)
    ('0.51', '12', '> 999')
    """
    return "> 999" if 999 < value < inf else significant(value, 2)


def share(value: float) -> str:
    """A coefficient of determination or another number near 1: all nines, and two digits beyond them.

    >>> share(0.998731), share(0.91), share(-3.2), share(1.0)
    ('0.9987', '0.910', '−3.20', '1.000')
    """
    special = _special(value)
    if special is not None:
        return special
    gap = abs(1 - value)
    decimals = 3 if gap >= 0.01 or gap == 0 else min(1 - floor(log10(gap)), 8)
    return _signed(f"{value:.{2 if value < 0 else decimals}f}")


def thousands(value: int) -> str:
    """A count with its digits in groups of three."""
    return f"{value:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def _special(value: float) -> str | None:
    """Text of what has no digits."""
    if isnan(value):
        return _MISSING
    if isinf(value):
        return "∞" if value > 0 else "−∞"
    return "0" if value == 0 else None


def _exponent(value: float, digits: int) -> int:
    """Decimal exponent after rounding to the given number of digits."""
    return int(f"{value:.{digits - 1}e}".partition("e")[2])


def _scientific(value: float, exponent: int, decimals: int) -> str:
    # scaled in text, because 10.0**exponent overflows where the value does not
    scaled = (
        float(f"{value:.16e}".partition("e")[0])
        * 10.0 ** (_exponent(value, 17) - exponent)
        if value
        else 0.0
    )
    return f"{_signed(f'{scaled:.{decimals}f}')}×10{str(exponent).translate(_SUPERSCRIPTS)}"


def _signed(text: str) -> str:
    """With a true minus sign, and no sign before zero."""
    if not text.startswith("-"):
        return text
    return f"−{text[1:]}" if text.strip("-0.") else text[1:]


# -- closed forms ------------------------------------------------------------------------------------------------------

FORM_WIDTH = 72
"""Characters of a closed form that are shown at once: a line of a table."""
FIRST_GROUPS = 3
"""Groups that are shown of a closed form that is longer."""


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
        if len(text) > FORM_WIDTH and len(expression.groups) > 1:
            start = closed_form(
                replace(expression, groups=expression.groups[:FIRST_GROUPS]), self.style
            )
            if len(expression.groups) <= FIRST_GROUPS:
                start = self.style.parameter(expression.name)
        terms = sum(len(group.parameters) for group in expression.groups)
        return ClosedForm(
            trusted(closed_form(expression, self.style)), text, trusted(start), terms
        )


def _split(name: str) -> tuple[str, str]:
    """A name and its index: ``Fv1`` → (Fv, 1), ``d4`` → (d, 4), ``Fc_elbow`` → (Fc, elbow)."""
    found = re.fullmatch(r"([^\W\d_]+)_?(\d\w*)|([^\W\d_]+)_(\w+)", one_line(name))
    if found is None:
        return name, ""
    return found[1] or found[3], found[2] or found[4]


def _indexed(stem: str, index: str) -> str:
    below = f"<sub>{escape(one_line(index).lstrip('_'))}</sub>" if index else ""
    return f"<i>{escape(one_line(stem))}</i>{below}"


# -- pages -------------------------------------------------------------------------------------------------------------

TEMPLATES = Path(__file__).with_name("templates")
VAGUE_PERCENT = 30.0
"""Standard deviation, per cent of a value, beyond which pages call the value vague."""
PACKED_NUMBER_BYTES = 4 * 4 / 3
"""Bytes of a number in a page, a 32-bit float in base 64."""
PLOT_BYTES = 1_200_000
"""Bytes of all plots of a page together, a quarter of those of the plotting library: the page opens as quickly."""
FEWEST_STRETCHES, MOST_STRETCHES = 100, 1200
"""Stretches of time in a plot: a curve still has a shape, and none is narrower than a pixel."""
Context = dict[str, Any]  # what a template shows


def html_page(
    title: str,
    prefix: str,
    titles: Mapping[str, str],
    contexts: Mapping[str, Context],
    data: Any,
    *,
    remarks: Mapping[str, str] = MappingProxyType({}),
    **page: Any,
) -> str:
    """A page as text: a header, and a section by each key of ``titles``, from templates ``PREFIX + KEY``.

    Remarks, by section, stand under titles.
    """
    html = {
        key: render(f"{prefix}{key}.html.j2", context)
        for key, context in contexts.items()
    }
    sections = [
        {
            "key": key,
            "title": text,
            "remark": remarks.get(key, ""),
            "html": html[key],
        }
        for key, text in titles.items()
    ]
    shown = {
        "title": title,
        "header": html["header"],
        "sections": sections,
        "version": __version__,
        **page,
    }
    return (
        str(
            render(
                "page.html.j2",
                {**shown, "data": script_safe(data), "plotly": plotly_source()},
            )
        )
        + "\n"
    )


def stretches_for(samples: Sequence[int], most_bytes: int = PLOT_BYTES) -> int:
    """Stretches of time into which signals with these numbers of samples are cut, as many as fit into a page.

    Two samples stay of each stretch, with a time and a value, and all samples of signals with fewer.
    """
    most = most_bytes / (2 * PACKED_NUMBER_BYTES)

    def is_large(stretches: int) -> bool:
        return sum(min(count, 2 * stretches) for count in samples) > most

    larger = range(FEWEST_STRETCHES + 1, MOST_STRETCHES + 1)
    return FEWEST_STRETCHES + bisect_left(larger, True, key=is_large)


def render(
    template: str, context: Mapping[str, Any], folder: Path = TEMPLATES
) -> Markup:
    """A template with its names filled in, as safe HTML; one of a folder may include those of reports."""
    return trusted(_environment(folder).get_template(template).render(context))


def trusted(html: str) -> Markup:
    """HTML whose names have been escaped already."""
    from markupsafe import Markup

    return Markup(html)


def plotly_source() -> Markup:
    """The plotting library, as the content of a script element."""
    with extra("identify"):
        from plotly.offline import get_plotlyjs
    # neither text occurs outside of string literals, where a backslash before / or ! changes nothing
    return trusted(
        get_plotlyjs().replace("</script", "<\\/script").replace("<!--", "<\\!--")
    )


def script_safe(data: Any) -> str:
    """JSON in which no text can end a script element; without numbers that are not finite."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def packed(values: npt.ArrayLike) -> str:
    """An array for a script: row-major, little endian, in base 64."""
    with np.errstate(over="ignore"):
        return b64encode(
            np.asarray(values, dtype=float).astype("<f4").tobytes()
        ).decode("ascii")


@cache
def _environment(folder: Path) -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader([folder, TEMPLATES]),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "line": one_line,
        "number": significant,
        "percent": percent,
        "share": share,
        "px": lambda value: f"{value:.1f}",
        "count": thousands,
    }
    return environment
