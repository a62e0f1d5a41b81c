"""Packages that only some jobs need, by the extra that installs them.

The core derives, verifies and writes code with NumPy and python-flint.  Whatever else a job imports is imported where
it is used, under ``with extra(...)``, so that its absence is one line with the command that installs it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from echelon.shared.errors import MissingExtraError

EXTRAS: dict[str, tuple[str, ...]] = {
    "fast": ("llvmlite",),
    "symbolic": ("sympy",),
    "identify": ("clarabel", "h5py", "plotly", "pyarrow", "scipy"),
    "notebook": ("pandas", "plotly"),
    "excite": ("mujoco", "plotly", "pyarrow", "scipy"),
    "ros": ("mcap", "rosbags"),
    "dask": ("cryptography", "dask", "distributed"),
    "mjcf": ("mujoco",),
    "jax": ("jax",),
    "torch": ("torch",),
    "robots": ("robot_descriptions", "xacro", "xacrodoc"),
}
"""Modules that the library imports from each extra of ``pyproject.toml``."""


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Imports in the block are those of an extra; if one of its modules is absent, the error names the extra."""
    try:
        yield
    except ImportError as error:
        module = (error.name or "").partition(".")[0]
        if module not in EXTRAS[name]:
            raise
        raise MissingExtraError(module, name) from None
