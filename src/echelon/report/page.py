"""The report: one page that needs nothing but itself.

A report is a list of sections; each has a template and a function that says what it shows.  The page forbids its own
requests to the network, so that it shows the same everywhere and tells nobody that it was opened.
"""

from __future__ import annotations

from echelon.errors import one_line
from echelon.identification.result import Identification
from echelon.report.environment import plotly_source, render
from echelon.report.payload import payload
from echelon.report.section import Section
from echelon.report.sections import (
    conditioning,
    header,
    links,
    parameters,
    physics,
    preparation,
    residuals,
    structure,
    summary,
    traces,
)
from echelon.version import __version__

SECTIONS = (
    Section("summary", "Fit of each output", summary.context),
    Section("parameters", "Base parameters", parameters.context),
    Section("traces", "Measured and predicted", traces.context),
    Section("residuals", "Residuals", residuals.context),
    Section("conditioning", "What the data show", conditioning.context),
    Section("links", "What the sensors see of each link", links.context),
    Section("structure", "Which parameters merge where", structure.context),
    Section("physics", "Physical consistency", physics.context),
    Section("preparation", "Preparation and settings", preparation.context),
)
"""The sections below the header, in order."""


def report_html(identification: Identification) -> str:
    """A report about an identification, as one HTML file.

    The same identification gives the same text.  Names that come from files are escaped; nothing is loaded from
    anywhere.

    Parameters
    ----------
    identification : Identification

    Returns
    -------
    str
        To be written as UTF-8.

    Raises
    ------
    MissingExtraError
        If plotly is not installed.
    """
    bodies = [
        {"key": s.key, "title": s.title, "html": render(f"{s.key}.html.j2", s.context(identification))}
        for s in SECTIONS
    ]
    head = header.context(identification)
    page = {
        "title": f"Identification of {one_line(identification.base.mechanism.name)}",
        "header": render("header.html.j2", head),
        "sections": bodies,
        "plotly": plotly_source(),
        "data": payload(identification.validations),
        "version": __version__,
    }
    return str(render("page.html.j2", page)) + "\n"
