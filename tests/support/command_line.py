"""The command line, run in this process or in one of its own."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from echelon.cli import main
from support.paths import ROOT


def run(
    *arguments: object, cwd: Path | None = None, **variables: str
) -> subprocess.CompletedProcess[str]:
    """A command in this process, which saves the time that imports take."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    with (
        chdir(cwd or Path.cwd()),
        redirect_stdout(out),
        redirect_stderr(err),
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setattr(sys, "argv", ["echelon", *map(str, arguments)])
        patch.setattr(os, "environ", {**os.environ, **variables})
        patch.delenv("ECHELON_TRACEBACK", raising=False)
        try:
            main()
        except SystemExit as ended:
            code = int(ended.code or 0)
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def run_alone(
    *arguments: str,
    cwd: Path | None = None,
    code: str = "from echelon.cli import main; main()",
    **variables: str,
) -> subprocess.CompletedProcess[str]:
    """A command in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), **variables}
    environment.pop("ECHELON_TRACEBACK", None)
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True, text=True, encoding="utf-8", cwd=cwd, env=environment, check=False,
    )  # fmt: skip
