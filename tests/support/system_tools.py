"""Programs beside Python that some tests use: a browser, Octave, compilers.

Their absence skips a test on a developer's machine and fails it in CI, where ``.ci/run`` installs them.  NVIDIA's
compiler is in no distribution, so it may be absent everywhere.
"""

from __future__ import annotations

import os
import shutil

import pytest

CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
OPTIONAL = ("nvcc",)


def tool(*names: str) -> str:
    """Path of the first of some programs that is installed."""
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None:
        absent = (
            pytest.fail
            if os.environ.get("CI") and not set(names) <= set(OPTIONAL)
            else pytest.skip
        )
        absent(f"{names[0]} is not installed")
    return found
