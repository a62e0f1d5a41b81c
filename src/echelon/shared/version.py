"""The version of the package, and where its documentation is."""

__version__ = "0.1.0"
DOCUMENTATION = ""
"""Address of the documentation, which a release fills in; a checkout has the pages in its folder ``docs``."""


def page(name: str) -> str:
    """Where to read a page of the documentation.

    >>> page("assumptions")
    'docs/assumptions.md'
    """
    return f"{DOCUMENTATION}{name}.html" if DOCUMENTATION else f"docs/{name}.md"
