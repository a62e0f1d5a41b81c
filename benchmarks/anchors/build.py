"""Compiles the anchors on first use, into a folder that is kept out of version control."""

from __future__ import annotations

import ctypes
import hashlib
import shutil
import subprocess
from collections.abc import Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

HERE = Path(__file__).parent
BUILT = HERE.parent / ".build"

OPTIMISED = ("-O3", "-march=native", "-DNDEBUG")
_SHARED = ("-shared", "-fPIC", "-pthread")


class UnavailableError(Exception):
    """An anchor cannot be had here; the message says what would bring it."""


def compiler(language: str = "c++") -> str:
    """The compiler's command."""
    names = {"c++": ("g++", "c++"), "c": ("gcc", "cc")}[language]
    for name in names:
        if found := shutil.which(name):
            return found
    raise UnavailableError(f"no {language.upper()} compiler: install {names[0]}")


@cache
def compiler_version(language: str = "c++") -> str:
    """The first line that the compiler says about itself."""
    return subprocess.run(
        [compiler(language), "--version"], check=True, capture_output=True, text=True
    ).stdout.split("\n", 1)[0]


def library(
    sources: Sequence[Path], flags: Sequence[str], language: str = "c++"
) -> ctypes.CDLL:
    """A shared library, compiled unless the same text, flags and compiler were met before.

    Raises
    ------
    UnavailableError
        If there is no compiler or it refuses.
    """
    # `native` means this processor, which a kept folder may outlive
    facts = [
        compiler_version(language),
        processor_flags(),
        *flags,
        *(s.read_text("utf-8") for s in sources),
    ]
    name = hashlib.sha256("\0".join(facts).encode()).hexdigest()[:16]
    path = BUILT / f"{sources[0].stem}-{name}.so"
    if not path.exists():
        BUILT.mkdir(exist_ok=True)
        partial = path.with_suffix(".partial")
        compiled_afresh(sources, flags, partial, language)
        partial.replace(path)
    return ctypes.CDLL(str(path))


def compiled_afresh(
    sources: Sequence[Path], flags: Sequence[str], path: Path, language: str = "c++"
) -> None:
    """Compile sources to a shared library.

    Raises
    ------
    UnavailableError
        If there is no compiler or it refuses.
    """
    command = [
        compiler(language),
        *flags,
        *_SHARED,
        *map(str, sources),
        "-lm",
        "-o",
        str(path),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        errors = [line for line in done.stderr.splitlines() if "error" in line]
        raise UnavailableError(
            f"{sources[0].name} does not compile: {errors[0] if errors else done.stderr[-400:]}"
        )


@cache
def processor_flags() -> str:
    """What the compiler takes `native` to be."""
    asked = [compiler(), "-march=native", "-Q", "--help=target"]
    told = subprocess.run(asked, check=False, capture_output=True, text=True).stdout
    return "\n".join(
        line.strip()
        for line in told.splitlines()
        if "-march=" in line or "[enabled]" in line
    )


def pinocchio_headers() -> list[str]:
    """Flags that lead to the headers of Pinocchio, Boost and Eigen which packages brought along."""
    roots = [
        _header_root("libpinocchio", "pinocchio/config.hpp")
        or _header_root("pin", "pinocchio/config.hpp")
    ]
    if roots[0] is None:
        raise UnavailableError(
            "the headers of Pinocchio are not installed: pip install 'echelon-robotics[bench]'"
        )
    with_eigen = [
        roots[0] / "eigen3",
        _header_root("casadi", "eigen3/Eigen/Core", "eigen3"),
        Path("/usr/include/eigen3"),
    ]
    eigen = next(
        (
            folder
            for folder in with_eigen
            if folder and (folder / "Eigen" / "Core").exists()
        ),
        None,
    )
    if eigen is None:
        raise UnavailableError(
            "the headers of Eigen are not installed: pip install casadi brings them"
        )
    return [f"-isystem{roots[0]}", f"-isystem{eigen}"]


def eigen_version() -> str:
    """The version of the Eigen that the anchor is compiled with."""
    text = (
        Path(pinocchio_headers()[1].removeprefix("-isystem"))
        / "Eigen/src/Core/util/Macros.h"
    ).read_text("utf-8")
    defined = dict(
        line.split()[1:3]
        for line in text.splitlines()
        if line.startswith("#define EIGEN_") and "VERSION " in line
    )
    return ".".join(
        defined[f"EIGEN_{part}_VERSION"] for part in ("WORLD", "MAJOR", "MINOR")
    )


def _header_root(package: str, header: str, below: str = "") -> Path | None:
    try:
        files = distribution(package).files or []
    except PackageNotFoundError:
        return None
    for file in files:
        if str(file).endswith(f"include/{header}"):
            path = Path(str(file.locate())).resolve()
            return path.parents[len(Path(header).parts) - 1] / below
    return None
