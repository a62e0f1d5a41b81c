"""Files of exports."""

from __future__ import annotations

from pathlib import Path

from flint import ctx

from support.rounded_exports.export import Export
from support.rounded_exports.geometry import BITS
from support.rounded_exports.mjcf import mjcf
from support.rounded_exports.sdf import sdf
from support.rounded_exports.urdf import urdf


def write(export: Export, folder: Path) -> Path:
    """The file to load, in a folder."""
    with ctx.workprec(BITS):
        if export.format.startswith("mjcf"):
            return _written(folder / f"{export.code}.xml", mjcf(export))
        if export.format == "sdf":
            return _written(folder / f"{export.code}.sdf", sdf(export))
        robot, beside = urdf(export)
        _written(folder / f"{export.code}.urdf", robot)
        return _written(folder / f"{export.code}.yaml", beside)


def _written(file: Path, text: str) -> Path:
    file.write_text(text, encoding="utf-8")
    return file
