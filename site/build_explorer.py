"""Build the explorer: one static folder with the page, Pyodide, the wheels that Echelon needs there, and robots.

    python site/build_explorer.py build/site/explorer --robots examples

Everything from elsewhere is named with its hash in ``site/explorer/lock.json`` and fetched through npm and pip, into a
cache.  NumPy for Pyodide is on no package index; Pyodide's own release has it, under a hash that the npm package
states.  Where that cannot be reached, NumPy is built from its source (see ``numpy_wheel.py``), or a folder holds an own
build of it (``--wheels``).  Without any the page is built, and says that it cannot answer.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import urllib.request
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "site" / "explorer"
sys.path[:0] = [str(ROOT / "src"), str(ROOT / "site"), str(PAGE)]

import browser_python  # noqa: E402  needs the path above
import numpy_wheel  # noqa: E402
from explorer import answer  # noqa: E402
from robot_zoo.exhibit import robot_files, stands_alone, usual_folders  # noqa: E402  needs the path above

LOCK = json.loads((PAGE / "lock.json").read_text())
BROWSER, NATIVE = "pyemscripten_2026_0_wasm32", "manylinux2014_x86_64"
RELEASE = "https://cdn.jsdelivr.net/pyodide/v{version}/full/{file}"
FIRST = "panda.yaml"  # the robot that a visitor sees first
VENDORED = {
    "pyodide": [
        "pyodide.mjs",
        "pyodide.asm.mjs",
        "pyodide.asm.wasm",
        "python_stdlib.zip",
    ],
    "katex": ["dist/katex.mjs", "dist/katex.min.css", "dist/fonts/*.woff2"],
    "three": [
        "build/three.module.js",
        "build/three.core.js",
        "examples/jsm/controls/OrbitControls.js",
    ],
}


def main() -> None:
    """Build into a folder that is made anew."""
    parser = argparse.ArgumentParser(description="Build the explorer into a folder.")
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--robots", type=Path, action="append", default=[], help="folder of robots"
    )
    parser.add_argument(
        "--wheels", type=Path, help="folder with an own wheel of NumPy for Pyodide"
    )
    parser.add_argument("--cache", type=Path, default=ROOT / "build" / "cache")
    given = parser.parse_args()
    missing = build(
        given.folder, given.robots or [ROOT / "examples"], given.cache, given.wheels
    )
    if missing:
        sys.stderr.write(
            f"the explorer lacks {', '.join(missing)} and cannot answer: give a folder with --wheels\n"
        )
        sys.exit(1 if os.environ.get("CI") else 0)


def build(
    folder: Path, robots: Sequence[Path], cache: Path, wheels: Path | None = None
) -> list[str]:
    """Everything into a folder, the installed packages of robots included; returns the wheels that could not be had."""
    build_page(folder, robots, cache, usual_folders())
    return _python(folder / "vendor", cache, wheels)


def build_page(
    folder: Path, robots: Sequence[Path], cache: Path, public: Sequence[Path] = ()
) -> None:
    """All but Python: the page, what it draws and typesets with, Pyodide without packages, robots.

    Robots of ``public`` folders, as the zoo has them, are shown with links to their pages in a zoo beside the explorer.
    """
    shutil.rmtree(folder, ignore_errors=True)
    vendor = folder / "vendor"
    vendor.mkdir(parents=True)
    cache.mkdir(parents=True, exist_ok=True)
    for file in PAGE.iterdir():
        if file.suffix in (".html", ".css", ".mjs"):
            shutil.copy(file, folder)
    shutil.copy(ROOT / "schemas" / "robot.schema.json", folder)
    _copy_robots(robots, public, folder)
    for name, (version, integrity) in LOCK["npm"].items():
        _unpack(_packed(name, version, integrity, cache), VENDORED[name], vendor)
    controls = vendor / "OrbitControls.js"
    controls.write_text(
        controls.read_text().replace("from 'three'", "from './three.module.js'")
    )


# -- robots ------------------------------------------------------------------------------------------------------------


def _copy_robots(robots: Sequence[Path], public: Sequence[Path], folder: Path) -> None:
    """Robots under the names that the zoo gives them, and a list of them, each with its pages in a zoo beside."""
    own, known = (
        [robot for source in robots for robot in robot_files([source])],
        robot_files(public),
    )
    found = {
        f"{robot.slug}{robot.path.suffix}": robot
        for robot in [*own, *known]
        if stands_alone(robot.path)
    }
    (folder / "robots").mkdir()
    pages = {}
    for name in sorted(found, key=lambda name: (name != FIRST, name)):
        robot = found[name]
        shutil.copy(robot.path, folder / "robots" / name)
        slugs = (robot.slug, f"{robot.slug}-floating") if robot in known else ()
        pages[name] = [
            slug
            for slug in slugs
            if (folder.parent / "zoo" / slug / "index.html").exists()
        ]
    (folder / "robots" / "robots.json").write_text(json.dumps(pages))
    # what a visitor sees while Python is loading
    first = next(iter(pages))
    text = (folder / "robots" / first).read_text(encoding="utf-8")
    reply = answer(json.dumps({"name": first, "text": text, "changes": {}}))
    (folder / "robots" / "first.json").write_text(reply)


# -- from npm ----------------------------------------------------------------------------------------------------------


def _packed(name: str, version: str, integrity: str, cache: Path) -> Path:
    """A package of npm, checked."""
    file = cache / f"{name}-{version}.tgz"
    if not file.exists():
        npm = shutil.which("npm") or sys.exit("the explorer's build needs npm")
        subprocess.run(
            [npm, "pack", "--silent", f"{name}@{version}"],
            cwd=cache,
            check=True,
            stdout=subprocess.DEVNULL,
        )
    digest = base64.b64encode(hashlib.sha512(file.read_bytes()).digest()).decode()
    if f"sha512-{digest}" != integrity:
        file.unlink()
        sys.exit(f"{file.name} is not the file that site/explorer/lock.json names")
    return file


def _unpack(package: Path, patterns: list[str], vendor: Path) -> None:
    with tarfile.open(package) as archive:
        for member in archive:
            path = Path(member.name).relative_to("package")
            if any(
                path.match(pattern) and len(path.parts) == len(Path(pattern).parts)
                for pattern in patterns
            ):
                target = (
                    vendor / ("fonts" if path.suffix == ".woff2" else "") / path.name
                )
                target.parent.mkdir(exist_ok=True)
                target.write_bytes(archive.extractfile(member).read())  # type: ignore[union-attr]


# -- Python packages ---------------------------------------------------------------------------------------------------


def _python(vendor: Path, cache: Path, wheels: Path | None) -> list[str]:
    """All packages, compiled, and what Pyodide has to know; the names of packages that cannot be had."""
    version = LOCK["npm"]["pyodide"][0]
    packed = cache / f"pyodide-{version}.tgz"
    with tarfile.open(packed) as archive:
        stated = json.load(archive.extractfile("package/pyodide-lock.json"))  # type: ignore[arg-type]
    files = [
        *_downloaded(LOCK["wheels"], BROWSER, cache),
        *_downloaded(_compiled(), NATIVE, cache),
    ]
    missing = []
    for name in LOCK["from Pyodide's release"]:
        entry = stated["packages"][name]
        found = _released(entry["file_name"], entry["sha256"], version, cache, wheels)
        found = found or numpy_wheel.built(packed, entry["file_name"], cache)
        files += [found] if found else []
        missing += [] if found else [name]
    lock = {"info": stated["info"], "packages": {}, "missing": missing}
    (vendor / "pyodide-lock.json").write_text(json.dumps(lock, indent=1))
    browser_python.pack(vendor, files, PAGE / "explorer.py", ROOT / "src")
    return missing


def _compiled() -> dict[str, str]:
    found: dict[str, str] = LOCK["without compiled parts"]
    return found


def _downloaded(pins: dict[str, str], platform: str, cache: Path) -> list[Path]:
    """Wheels of a platform by pip, which checks their hashes."""
    folder = (
        cache
        / f"{platform}-{hashlib.sha256(json.dumps(pins).encode()).hexdigest()[:12]}"
    )
    if not folder.exists():
        lines = [f"{pin} --hash=sha256:{digest}\n" for pin, digest in pins.items()]
        with tempfile.TemporaryDirectory(dir=cache) as place:
            requirements = Path(place, "requirements.txt")
            requirements.write_text("".join(lines))
            command = [
                sys.executable,
                "-m",
                "pip",
                "download",
                "--quiet",
                "--no-deps",
                "--require-hashes",
            ]
            command += [
                "--only-binary=:all:",
                "--python-version=3.14",
                "--implementation=cp",
                "--abi=cp314",
            ]
            command += [
                f"--platform={platform}",
                f"--dest={place}/wheels",
                f"--requirement={requirements}",
            ]
            subprocess.run(command, check=True)
            Path(place, "wheels").rename(folder)
    return sorted(folder.glob("*.whl"))


def _released(
    file: str, sha256: str, version: str, cache: Path, wheels: Path | None
) -> Path | None:
    """A wheel of a folder, or else of Pyodide's release, which is checked; None if it cannot be had."""
    if (
        wheels is not None and (wheels / file).exists()
    ):  # who names a folder answers for what is in it
        return wheels / file
    if (cache / file).exists() and _sha256(cache / file) == sha256:
        return cache / file
    found = cache / file
    try:
        with urllib.request.urlopen(
            RELEASE.format(version=version, file=file), timeout=60
        ) as answer:
            found.write_bytes(answer.read())
    except OSError:
        return None
    if _sha256(found) != sha256:
        found.unlink()
        sys.exit(f"{file} is not the file that Pyodide {version} names")
    return found


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


if __name__ == "__main__":
    main()
