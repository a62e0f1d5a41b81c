"""Doors of rooms: names of a package that are imported when they are first asked for.

A package states in the stub beside its ``__init__.py`` what others may import from it, and where each name is defined.
Type checkers read the stub, and so does :func:`door`, so that no command waits for modules that it does not need.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

_IMPORT = re.compile(r"^from (\S+) import\s+\(?\s*\w+ as (\w+)", re.MULTILINE)


def door(
    package: str,
) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """``__all__``, ``__getattr__`` and ``__dir__`` of a package, from its stub ``__init__.pyi``.

    The stub's lines ``from module import name as name`` are read.
    """
    module: Any = sys.modules[package]
    spec = module.__spec__
    # an installation may hold compiled files only
    source = spec.origin.removesuffix("c")
    stub = spec.loader.get_data(f"{source}i").decode()
    home = {name: place for place, name in _IMPORT.findall(stub)}
    names = sorted(home)

    def get(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        found = getattr(import_module(home[name]), name)
        setattr(module, name, found)
        return found

    return names, get, lambda: names
