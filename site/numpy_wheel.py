"""Build NumPy for Pyodide from its source, where Pyodide's release cannot be reached but PyPI and Debian's mirror can.

    python site/numpy_wheel.py build/cache/pyodide-314.0.7.tgz numpy.whl

Nothing is installed and no rights are needed.  The compiler is the clang of Zig's wheel, with LLVM's linker, which both
know the target.  The headers of Emscripten and Python are taken out of Debian's packages; what Python was configured
with, Pyodide's library says.  NumPy's own build asks which functions exist: those that Pyodide exports.
"""

from __future__ import annotations

import hashlib
import io
import json
import lzma
import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import urllib.error
import urllib.request
import zipfile
from pathlib import Path
from typing import Any

PINS: dict[str, Any] = json.loads(
    (Path(__file__).parent / "explorer" / "lock.json").read_text()
)["numpy"]
MIRROR = "https://deb.debian.org/debian/"
ARCHIVE = "https://snapshot.debian.org/archive/debian/20261124T000000Z/"
NEWEST = "ECHELON_NEWEST_HEADERS"
"""Debian's mirror, which has the pinned packages while they are the newest; its archive, which keeps them; and the
variable that, set to 1, takes whatever is newest on the mirror."""
SYSTEM, PYTHON = "usr/share/emscripten/system", "usr/include/python3.14"
HEADERS = {"emscripten": SYSTEM, "libpython3.14-dev": PYTHON}
"""Debian's packages, and which of their folders is needed; versions and digests are in `lock.json`."""
MUSL = [
    f"lib/libc/musl/{folder}"
    for folder in ("include", "arch/emscripten", "arch/generic")
]
C, CPP = (
    ["include/compat", "include", *MUSL],
    ["lib/libcxx/include", "lib/libcxxabi/include"],
)
FLAGS = "--target=wasm32-unknown-emscripten -fPIC -fwasm-exceptions -mllvm -wasm-enable-sjlj -nostdinc -nostdlib"
LINK = "--no-entry --experimental-pic --export-if-defined=main --export-if-defined=__main_void"
SCRIPT = """#!/bin/sh
# without what this linker does not know, and without the headers of the Python that runs the build
for word do shift; case $word in --*-group|-I*/python3.*) ;; *) set -- "$@" "$word" ;; esac; done
exec {zig} {before} "$@" {after}
"""
CROSS = """[binaries]
c = '{bin}/cc'
cpp = '{bin}/c++'
ar = ['{zig}', 'ar']
[host_machine]
system = 'emscripten'
cpu_family = 'wasm32'
cpu = 'wasm32'
endian = 'little'
[properties]
longdouble_format = 'IEEE_QUAD_LE'
"""
OPTIONS = (
    "buildtype=release b_ndebug=true python.bytecompile=-1 python.platlibdir=/ python.purelibdir=/ \
blas=none lapack=none disable-optimization=true disable-threading=true"
)
EXPORTS = "const m = new WebAssembly.Module(require('fs').readFileSync(0)); \
for (const e of WebAssembly.Module.exports(m)) console.log(e.name)"


def built(pyodide: Path, file: str, cache: Path) -> Path | None:
    """The wheel of that name for the packed Pyodide of npm; None, with the reason in a log, if it cannot be built."""
    digest = hashlib.sha256(
        Path(__file__).read_bytes() + json.dumps(PINS).encode() + pyodide.read_bytes()
    )
    wheel = cache / f"numpy-{digest.hexdigest()[:12]}" / file
    if not wheel.exists():
        print("building NumPy for Pyodide, which takes some minutes", flush=True)
        log = cache / "numpy.log"
        try:
            with log.open("w") as output, tempfile.TemporaryDirectory() as place:
                build(Path(place).resolve(), pyodide, wheel, output)
        except (OSError, subprocess.CalledProcessError) as error:
            print(f"NumPy could not be built: {error}; see {log}", flush=True)
            return None
    return wheel


def build(place: Path, pyodide: Path, wheel: Path, output: Any) -> None:
    """Everything from sources to the wheel, in an empty folder."""
    with tarfile.open(pyodide) as archive:
        packed = {
            name: archive.extractfile(f"package/{name}")
            for name in ("python_stdlib.zip", "pyodide.asm.wasm")
        }
        library, program = (part.read() for part in packed.values() if part)
    variables = configuration(library)
    for package in HEADERS:
        _unpack_debian(_packed(package), place)
    config = [
        f"#define {name} {value}\n"
        for name, value in variables.items()
        if isinstance(value, int) and value
    ]
    (place / PYTHON / "pyconfig.h").write_text(
        "".join(["#define _GNU_SOURCE 1\n", *config])
    )
    _compilers(place, program, output)
    with tarfile.open(fileobj=io.BytesIO(_fetched(*PINS["source"]))) as archive:
        archive.extractall(place, filter="data")
    _compile(place, next(place.glob("numpy-*")), output)
    _pack(place / "installed", variables["EXT_SUFFIX"], wheel)


def configuration(library: bytes) -> dict[str, Any]:
    """What Pyodide's Python was configured with."""
    with zipfile.ZipFile(io.BytesIO(library)) as archive:
        name = next(
            name for name in archive.namelist() if name.startswith("_sysconfigdata_")
        )
        names: dict[str, Any] = {}
        exec(archive.read(name), names)
    found: dict[str, Any] = names["build_time_vars"]
    return found


# -- what is needed ----------------------------------------------------------------------------------------------------


def _fetched(address: str, sha256: str | None = None) -> bytes:
    with urllib.request.urlopen(address, timeout=60) as answer:
        content: bytes = answer.read()
    if sha256 and hashlib.sha256(content).hexdigest() != sha256:
        raise OSError(f"{address} is not the file with SHA-256 {sha256}")
    return content


def _packed(package: str) -> bytes:
    """A package of Debian: the pinned one, or by its index the newest where that is asked for."""
    path, digest = PINS["headers"][package]
    if os.environ.get(NEWEST) == "1":
        index = lzma.decompress(
            _fetched(f"{MIRROR}dists/sid/main/binary-amd64/Packages.xz")
        ).decode()
        entry = re.search(
            rf"^Package: {re.escape(package)}\n(?:.+\n)*", index, re.MULTILINE
        )
        if entry is None:
            raise OSError(f"Debian has no package {package} any more")
        fields = dict(
            line.split(": ", 1) for line in entry[0].splitlines() if ": " in line
        )
        path, digest = fields["Filename"], fields["SHA256"]
    for place in (MIRROR, ARCHIVE):
        try:
            return _fetched(place + path, digest)
        except urllib.error.URLError:
            continue
    raise OSError(
        f"neither {MIRROR} nor its archive has {path}; {NEWEST}=1 takes the newest there is"
    )


def _unpack_debian(package: bytes, place: Path) -> None:
    """The folders that are needed of a package: an archive of ``ar`` with one of ``tar`` in it."""
    start = 8
    while start < len(package):
        name, size = (
            package[start : start + 16].decode(),
            int(package[start + 48 : start + 58]),
        )
        if name.startswith("data.tar"):
            with tarfile.open(
                fileobj=io.BytesIO(package[start + 60 : start + 60 + size])
            ) as archive:
                wanted = [
                    m
                    for m in archive
                    if m.name.startswith(
                        tuple(f"./{path}/" for path in HEADERS.values())
                    )
                ]
                archive.extractall(place, wanted, filter="data")
        start += 60 + size + size % 2


def _compilers(place: Path, program: bytes, output: Any) -> None:
    """Tools of the package index, and scripts that call compilers and linker in the way that NumPy's build does."""
    pins = [
        " --hash=sha256:".join([pin, *digests])
        for pin, digests in PINS["tools"].items()
    ]
    (place / "tools.txt").write_text("\n".join(pins))
    pip = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-deps",
        "--require-hashes",
        "--only-binary=:all:",
    ]
    _run(
        [*pip, f"--target={place}/tools", f"--requirement={place}/tools.txt"],
        place,
        output,
    )
    exports = subprocess.run(
        ["node", "-e", EXPORTS], input=program, capture_output=True, check=True
    ).stdout
    (place / "exports.txt").write_bytes(exports)
    zig, bin = place / "tools" / "ziglang" / "zig", place / "bin"
    own = [
        zig.parent / "lib" / "include",
        *(place / SYSTEM / path for path in C),
        place / PYTHON,
    ]
    c = " ".join(f"-isystem {path}" for path in own)
    cpp = " ".join(f"-isystem {place / SYSTEM / path}" for path in CPP)
    flags = f"{FLAGS} -B{bin} -Wno-unused-command-line-argument"
    bin.mkdir()
    for name, before, after in [
        ("cc", f"clang {flags}", c),
        ("c++", f"clang --driver-mode=g++ {flags}", f"{cpp} {c}"),
        ("wasm-ld", "wasm-ld", f"{LINK} --allow-undefined-file={place}/exports.txt"),
    ]:
        (bin / name).write_text(SCRIPT.format(zig=zig, before=before, after=after))
        (bin / name).chmod(0o755)
    (place / "cross.ini").write_text(CROSS.format(bin=bin, zig=zig))


# -- the wheel ---------------------------------------------------------------------------------------------------------


def _compile(place: Path, source: Path, output: Any) -> None:
    meson = [sys.executable, str(source / "vendored-meson" / "meson" / "meson.py")]
    options = [f"-D{option}" for option in OPTIONS.split()]
    _run(
        [
            *meson,
            "setup",
            "build",
            str(source),
            f"--cross-file={place}/cross.ini",
            *options,
        ],
        place,
        output,
    )
    _run(["ninja", "-C", "build"], place, output)
    installed = [
        f"--destdir={place}/installed",
        "--no-rebuild",
        "--tags=runtime,python-runtime",
    ]
    _run([*meson, "install", "-C", "build", *installed], place, output)


def _run(command: list[str], place: Path, output: Any) -> None:
    tools = place / "tools"
    environment = {
        **os.environ,
        "PYTHONPATH": str(tools),
        "PATH": f"{tools / 'bin'}{os.pathsep}{os.environ['PATH']}",
    }
    subprocess.run(
        command,
        check=True,
        cwd=place,
        env=environment,
        stdout=output,
        stderr=subprocess.STDOUT,
    )


def _pack(installed: Path, suffix: str, wheel: Path) -> None:
    """The installed files as a wheel, compiled parts under the ending that Pyodide's Python looks for."""
    name, version, *tags = wheel.stem.split("-")
    about = {
        "METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n",
        "WHEEL": f"Wheel-Version: 1.0\nRoot-Is-Purelib: false\nTag: {'-'.join(tags)}\n",
    }
    wheel.parent.mkdir(parents=True, exist_ok=True)
    part = wheel.with_suffix(".part")
    with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(path for path in installed.rglob("*") if path.is_file()):
            inside = str(file.relative_to(installed)).replace(
                sysconfig.get_config_var("EXT_SUFFIX"), suffix
            )
            archive.writestr(
                zipfile.ZipInfo(inside), file.read_bytes(), zipfile.ZIP_DEFLATED
            )
        for part_name, text in about.items():
            archive.writestr(
                zipfile.ZipInfo(f"{name}-{version}.dist-info/{part_name}"), text
            )
    part.rename(wheel)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        build(Path(scratch).resolve(), Path(sys.argv[1]), Path(sys.argv[2]), sys.stdout)
