"""Templates of the report: everything that comes from a file is escaped, and a name without value is an error.

jinja2 is imported here only, and only when a report is made.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from echelon.errors import MissingExtraError, one_line
from echelon.report import digits

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

TEMPLATES = Path(__file__).with_name("templates")


def render(template: str, context: Mapping[str, Any]) -> Markup:
    """A template with its names filled in, as safe HTML."""
    from markupsafe import Markup

    return Markup(_environment().get_template(template).render(context))


def trusted(html: str) -> Markup:
    """HTML whose names have been escaped already."""
    from markupsafe import Markup

    return Markup(html)


def plotly_source() -> Markup:
    """The plotting library, as the content of a script element."""
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        raise MissingExtraError("plotly", "identify") from None
    # neither text occurs outside of string literals, where a backslash before / or ! changes nothing
    return trusted(get_plotlyjs().replace("</script", "<\\/script").replace("<!--", "<\\!--"))


@cache
def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "line": one_line,
        "number": digits.significant,
        "percent": digits.percent,
        "share": digits.share,
        "px": lambda value: f"{value:.1f}",
        "count": lambda value: f"{value:,}".replace(",", "\N{NARROW NO-BREAK SPACE}"),
    }
    return environment
