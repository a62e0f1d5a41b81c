"""Errors, names, files and checks that all rooms share; knows nothing of robots.

Errors that name the file and the element; names that may be given to things; public functions whose arguments are
checked where they enter (``doors``); files that are read within limits (``inputs``), declared key by key (``records``)
and written whole (``files``); optional packages (``extras``); the order, names and units of the standard parameters
(``conventions``).
"""

from echelon.shared.facade import door

__all__, __getattr__, __dir__ = door(__name__)
