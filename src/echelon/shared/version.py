"""The version of the package, and where its documentation is."""

import os

__version__ = "0.1.0"
DOCUMENTATION = ""
"""Address of the documentation, which a release fills in."""


def page(name: str) -> str:
    """Where to read a page of the documentation: on its site, in the installed package, or in the checkout.

    >>> page("assumptions")
    'docs/assumptions.md'
    """
    if DOCUMENTATION:
        return f"{DOCUMENTATION}{name}.html"
    shipped = os.path.join(os.path.dirname(os.path.dirname(__file__)), f"{name}.md")
    return shipped if os.path.isfile(shipped) else f"docs/{name}.md"
