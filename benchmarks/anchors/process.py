"""Measurements in a fresh process, with an environment of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from typing import Any

from anchors.build import HERE


def probe(
    name: str, *arguments: str, environment: Mapping[str, str] | None = None
) -> Any:
    """Run ``probes.name`` and return what it prints.

    Parameters
    ----------
    name : str
        A module of the folder ``probes``.
    *arguments : str
    environment : mapping of str to str, optional
        Variables to set beside those of this process.
    """
    command = [sys.executable, "-m", f"probes.{name}", *arguments]
    variables = {**os.environ, **(environment or {})}
    done = subprocess.run(
        command,
        cwd=HERE.parent,
        env=variables,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(
            f"{name} {' '.join(arguments)} failed:\n{done.stderr[-2000:]}"
        )
    return json.loads(done.stdout.splitlines()[-1])
