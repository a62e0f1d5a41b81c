"""Python as the explorer's visitors get it: what the page can import, compiled, in two archives.

A browser that gets wheels spends most of a first visit on compiling source text and on names of libraries.  So the
modules are compiled here, by the Python of Pyodide itself, under node; of Echelon only those are taken that the page
can reach; and libraries export only what others import.  FLINT exports 14,000 names, which Emscripten's loader goes
through once for each of forty modules.
"""

from __future__ import annotations

import ast
import gzip
import io
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

SITE = Path(__file__).parent
PACKED = "packages.bin"
"""Name of the archive; servers unpack what is called .gz."""
UNUSED = re.compile(
    r"(^|/)(tests?|_pyinstaller|distutils|f2py|v1)/|\.dist-info/[^l][^/]*$|linux-gnu\.so$|\.(pyi|pxd|h|c|a|typed)$"
)
"""Files of wheels that no page imports."""
EXPORTS, IMPORTS = 7, 2  # sections of a module of WebAssembly
NEEDED = (
    b"__wasm",
    b"PyInit_",
)  # exports that the loaders of Emscripten and Python ask for


def pack(vendor: Path, wheels: Sequence[Path], page: Path, source: Path) -> None:
    """The library of Pyodide in a folder, compiled in its place, and all packages beside it.

    ``page`` is the module that answers, and ``source`` the folder of Echelon's modules.
    """
    with tempfile.TemporaryDirectory() as folder:
        library, packages = Path(folder, "library"), Path(folder, "packages")
        with zipfile.ZipFile(vendor / "python_stdlib.zip") as archive:
            archive.extractall(library)
        for wheel in wheels:
            with zipfile.ZipFile(wheel) as archive:
                archive.extractall(
                    packages,
                    [name for name in archive.namelist() if not UNUSED.search(name)],
                )
        _copy_own(page, source, packages)
        _trim(sorted(packages.rglob("*.so")))
        node = shutil.which("node") or sys.exit("the explorer's build needs node")
        subprocess.run(
            [node, SITE / "compile.mjs", vendor, folder],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        with zipfile.ZipFile(
            vendor / "python_stdlib.zip", "w", zipfile.ZIP_DEFLATED
        ) as archive:
            for name, content in _files(library):
                archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
        whole = io.BytesIO()
        with tarfile.open(
            fileobj=whole, mode="w", format=tarfile.USTAR_FORMAT
        ) as archive:
            for name, content in _files(packages):
                entry = tarfile.TarInfo(name)
                entry.size = len(content)
                archive.addfile(entry, io.BytesIO(content))
        (vendor / PACKED).write_bytes(gzip.compress(whole.getvalue(), mtime=0))


def _files(folder: Path) -> Iterator[tuple[str, bytes]]:
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        yield file.relative_to(folder).as_posix(), file.read_bytes()


# -- modules -----------------------------------------------------------------------------------------------------------


def _copy_own(page: Path, source: Path, packages: Path) -> None:
    """The page's module, what it can reach of Echelon, and all files there that are no modules."""
    shutil.copy(page, packages)
    others = {
        file
        for file in source.rglob("*")
        if file.is_file() and file.suffix not in (".py", ".pyc")
    }
    for file in others | reachable(page, source):
        target = packages / file.relative_to(source)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, target)


def reachable(start: Path, source: Path) -> set[Path]:
    """Files of the modules below a folder that a file imports, itself or through others, anywhere in their text."""
    found: set[Path] = set()
    waiting = [start]
    while waiting:
        for name in _imported(waiting.pop().read_text(encoding="utf-8"), source):
            place = source / name.replace(".", "/")
            for file in (place.with_suffix(".py"), place / "__init__.py"):
                if file.exists() and file not in found:
                    found.add(file)
                    waiting.append(file)
    return found


def _imported(text: str, source: Path) -> Iterator[str]:
    """Names of modules that a text may import, and of the packages around them.

    What a package imports when it is first asked for stands in the stub beside it.
    """
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            for wanted in (name, _behind_door(name, source)):
                parts = wanted.split(".")
                yield from (".".join(parts[:end]) for end in range(1, len(parts) + 1))


def _behind_door(name: str, source: Path) -> str:
    """The module that a package imports for a name; the name itself where it imports none."""
    package, _, wanted = name.rpartition(".")
    stub = source / package.replace(".", "/") / "__init__.pyi"
    if not (package and stub.exists()):
        return name
    text = stub.read_text(encoding="utf-8")
    found = re.search(rf"^from (\S+) import\s+\(?\s*{wanted} as", text, re.MULTILINE)
    return found[1] if found else name


# -- libraries ---------------------------------------------------------------------------------------------------------


def _trim(libraries: Sequence[Path]) -> None:
    """Take away what libraries export but none imports."""
    contents = {file: file.read_bytes() for file in libraries}
    wanted = {
        name for content in contents.values() for name, _ in _entries(content, IMPORTS)
    }
    for file, content in contents.items():
        file.write_bytes(_with_exports(content, wanted))


def _with_exports(content: bytes, wanted: set[bytes]) -> bytes:
    kept = [
        entry
        for name, entry in _entries(content, EXPORTS)
        if name in wanted or name.startswith(NEEDED)
    ]
    parts = [content[:8]]
    for kind, body in _sections(content):
        part = _number(len(kept)) + b"".join(kept) if kind == EXPORTS else body
        parts += [bytes([kind]), _number(len(part)), part]
    return b"".join(parts)


def _sections(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Kinds and contents of sections; see https://webassembly.github.io/spec/core/binary/modules.html."""
    at = 8
    while at < len(content):
        size, start = _read(content, at + 1)
        yield content[at], content[start : start + size]
        at = start + size


def _entries(content: bytes, section: int) -> Iterator[tuple[bytes, bytes]]:
    """Names and texts of imports or exports."""
    for body in (body for kind, body in _sections(content) if kind == section):
        count, at = _read(body, 0)
        for _ in range(count):
            start = at
            if section == IMPORTS:
                at = _after_name(body, at)  # the module's
            end = _after_name(body, at)
            name = body[_read(body, at)[1] : end]
            at = (
                _read(body, end + 1)[1]
                if section == EXPORTS
                else _after_type(body, end)
            )
            yield name, body[start:at]


def _after_name(body: bytes, at: int) -> int:
    length, start = _read(body, at)
    return start + length


def _after_type(body: bytes, at: int) -> int:
    """Where the type of an import ends: of a function, a table, a memory, a global value or a tag."""
    kind, at = body[at], at + 1
    if kind in (1, 2):  # limits, of tables after the type of their elements
        at += kind == 1
        bounds, at = body[at], _read(body, at + 1)[1]
        return _read(body, at)[1] if bounds & 1 else at
    return at + 2 if kind == 3 else _read(body, at + (kind == 4))[1]


def _read(content: bytes, at: int) -> tuple[int, int]:
    """A number of seven bits per byte, the lowest first, and where it ends."""
    value = shift = 0
    while True:
        byte, at = content[at], at + 1
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return value, at


def _number(value: int) -> bytes:
    head = bytes([value & 127 | (128 if value > 127 else 0)])
    return head + _number(value >> 7) if value > 127 else head
