"""Robot files in folders: what looks like a robot by its ending and root element, each with a name of its own."""

from __future__ import annotations

import os
import re
import sysconfig
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from echelon.errors import InputError

_ROOTS = {
    ".urdf": rb"",
    ".sdf": rb"<sdf\b",
    ".xml": rb"<(robot|mujoco)\b[\s\S]*<(joint|freejoint)\b",
    ".mjcf": rb"<mujoco\b",
    ".yaml": rb"(?m)^echelon:",
    ".yml": rb"(?m)^echelon:",
}
"""What must stand in a file with each ending; a URDF that is damaged is an entry, too."""
_LARGEST = 20_000_000  # bytes; what is larger is no robot


@dataclass(frozen=True)
class Found:
    """A robot file."""

    path: Path
    place: str  # its path below the folder that was searched
    slug: str  # a name for folders and addresses, unlike all others


def usual_folders() -> list[Path]:
    """The folders of the packages ``example-robot-data`` and ``robot_descriptions`` that are there."""
    installed = Path(sysconfig.get_path("purelib")) / "cmeel.prefix" / "share" / "example-robot-data" / "robots"
    cached = Path(os.environ.get("ROBOT_DESCRIPTIONS_CACHE", "~/.cache/robot_descriptions")).expanduser()
    return [folder for folder in (installed, cached) if folder.is_dir()]


def robot_files(folders: Sequence[Path]) -> list[Found]:
    """All robot files below folders, in the order of their paths."""
    found = []
    for folder in folders:
        if not folder.is_dir():
            raise InputError("is not a directory", source=str(folder))
        paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() in _ROOTS and path.is_file())
        found += [(path, path.relative_to(folder)) for path in paths if _is_robot(path)]
    stems = Counter(_slug(place.stem) for _, place in found)
    return [
        Found(path, place.as_posix(), slug) for (path, place), slug in zip(found, _slugs(found, stems), strict=True)
    ]


def _slugs(found: list[tuple[Path, Path]], stems: Counter[str]) -> list[str]:
    """The name of the file; with that of its package where others have the same, and then a number."""
    taken: Counter[str] = Counter()
    slugs = []
    for _, place in found:
        slug = _slug(place.stem)
        if stems[slug] > 1 and len(place.parts) > 1:
            slug = f"{_slug(place.parts[0].removesuffix('_description'))}-{slug}"
        taken[slug] += 1
        slugs.append(slug if taken[slug] == 1 else f"{slug}-{taken[slug]}")
    return slugs


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "robot"


def stands_alone(path: Path) -> bool:
    """Whether a robot file needs no other file and no MuJoCo, so that the explorer can read it in a browser."""
    if path.suffix not in (".urdf", ".yaml"):
        return False
    return not re.search(r"^(robot|model):", path.read_text(encoding="utf-8", errors="replace"), re.MULTILINE)


def _is_robot(path: Path) -> bool:
    pattern = _ROOTS[path.suffix.lower()]
    if not pattern:
        return True
    try:
        return path.stat().st_size < _LARGEST and re.search(pattern, path.read_bytes()) is not None
    except OSError:
        return False
