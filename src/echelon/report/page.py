"""One page that needs nothing but itself: sections with templates, numbers packed for scripts, and no network.

Everything that comes from a file is escaped, and a name without value is an error.  A page forbids its own requests to
the network, so that it shows the same everywhere and opening it leaves no trace.  Arrays are 32-bit floats in
base 64: seven digits are more than a screen shows, and a third of the size of decimal text.  jinja2 is imported here
only, and only when a page is made.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from echelon.errors import one_line
from echelon.extras import extra
from echelon.report import digits
from echelon.version import __version__

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

TEMPLATES = Path(__file__).with_name("templates")
Context = dict[str, Any]
"""What a template shows."""


def html_page(
    title: str, prefix: str, titles: Mapping[str, str], contexts: Mapping[str, Context], data: Any, **page: Any
) -> str:
    """A page as text: a header, and a section by each key of ``titles``, from templates ``PREFIX + KEY``."""
    html = {key: render(f"{prefix}{key}.html.j2", context) for key, context in contexts.items()}
    sections = [{"key": key, "title": text, "html": html[key]} for key, text in titles.items()]
    shown = {"title": title, "header": html["header"], "sections": sections, "version": __version__, **page}
    return str(render("page.html.j2", {**shown, "data": script_safe(data), "plotly": plotly_source()})) + "\n"


def render(template: str, context: Mapping[str, Any], folder: Path = TEMPLATES) -> Markup:
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
    return trusted(get_plotlyjs().replace("</script", "<\\/script").replace("<!--", "<\\!--"))


def script_safe(data: Any) -> str:
    r"""JSON in which no text can end a script element; without numbers that are not finite.

    >>> script_safe({"name": "</script>"})
    '{"name":"\\u003c/script\\u003e"}'
    """
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def packed(values: npt.ArrayLike) -> str:
    """An array for a script: row-major, little endian, in base 64."""
    with np.errstate(over="ignore"):
        return b64encode(np.asarray(values, dtype=float).astype("<f4").tobytes()).decode("ascii")


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
        "number": digits.significant,
        "percent": digits.percent,
        "share": digits.share,
        "px": lambda value: f"{value:.1f}",
        "count": lambda value: f"{value:,}".replace(",", "\N{NARROW NO-BREAK SPACE}"),
    }
    return environment
