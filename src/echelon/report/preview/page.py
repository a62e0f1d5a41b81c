"""The preview: one page that shows a trajectory, and how far it stays from every limit, before a robot runs it.

What would stop an engineer comes first: broken limits, then warnings.  The motion follows, then the numbers.  Like the
report, the page forbids its own requests to the network.
"""

from __future__ import annotations

from echelon.errors import one_line
from echelon.excite.exciting_trajectory import ExcitingTrajectory
from echelon.report.environment import plotly_source, render
from echelon.report.payload import script_safe
from echelon.report.preview import header, limits, motion, scene, showing, starts
from echelon.report.section import Section
from echelon.version import __version__

SECTIONS = (
    Section("robot", "How the robot moves", scene.context),
    Section("motion", "Joint motion against its limits", motion.context),
    Section("limits", "Margins to every limit", limits.context),
    Section("showing", "What the motion will show", showing.context),
    Section("starts", "Starts of the optimisation", starts.context),
    Section("settings", "Settings", starts.settings),
)
"""The sections below the header, in order."""


def preview_html(found: ExcitingTrajectory) -> str:
    """A page about an exciting trajectory, as one HTML file.

    The same trajectory gives the same text.  Names that come from files are escaped; nothing is loaded from anywhere.

    Parameters
    ----------
    found : ExcitingTrajectory

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
        {"key": s.key, "title": s.title, "html": render(f"preview_{s.key}.html.j2", s.context(found))} for s in SECTIONS
    ]
    data = {
        "robot": scene.payload(found),
        "motion": motion.payload(found),
        "conditioning": showing.payload(found),
        "starts": starts.payload(found),
    }
    page = {
        "title": f"Exciting trajectory of {one_line(found.base.mechanism.name)}",
        "header": render("preview_header.html.j2", header.context(found)),
        "sections": bodies,
        "plotly": plotly_source(),
        "data": script_safe(data),
        "version": __version__,
    }
    return str(render("preview.html.j2", page)) + "\n"
