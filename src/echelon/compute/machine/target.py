"""The processor that machine code is made for, and object code: made by LLVM from text, kept, loaded into this process.

Object code is kept on disk between processes.  An entry holds the key it was made for and a digest of its contents.  A
file that is damaged, that was made for another key, or that others could write to, itself or its folder, is not used:
the code is then made again.  The key covers the source text and everything else the code depends on, so nothing is ever
stale.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import errno
import hashlib
import os
import stat
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from echelon.shared import (
    EchelonError,
    InputError,
    MissingExtraError,
    extra,
    write_atomically,
)

_WIDTHS = (2, 4, 8)
_WIDEST = _WIDTHS[-1]
_LIBRARY_FUNCTIONS = ("sin", "cos", "exp", "log", "tanh", "atan", "memcpy", "memset")


@dataclass(frozen=True)
class Target:
    """A processor, as LLVM names it."""

    triple: str
    cpu: str
    features: str
    lanes: int  # samples that one vector holds: 8 (AVX-512), 4 (AVX2) or 2 (NEON, SSE2)

    @property
    def identity(self) -> str:
        """Everything that object code depends on beside its source."""
        import llvmlite

        version = ".".join(map(str, llvm().llvm_version_info))
        return f"{self.triple} {self.cpu} {self.features} {self.lanes} llvmlite {llvmlite.__version__} LLVM {version}"

    def machine(self) -> Any:
        """LLVM's code generator; programs are straight lines in good order, so effort 1 is as good as 3 and faster."""
        target = llvm().Target.from_triple(self.triple)
        return target.create_target_machine(
            cpu=self.cpu,
            features=self.features,
            opt=1,
            reloc="pic",
            codemodel="jitdefault",
        )


@cache
def host(lanes: int | None = None) -> Target:
    """The processor at hand, with vectors as wide as it has, or as ``ECHELON_LANES`` or the caller says."""
    known = llvm().get_host_cpu_features()
    # without fused multiply-add every reduction of an angle would call a library, so such vectors are not worth having
    widest = (
        8
        if known.get("avx512f")
        else 4
        if known.get("avx2") and known.get("fma")
        else 2
    )
    wanted = str(lanes or os.environ.get("ECHELON_LANES") or widest)
    valid = [str(width) for width in _WIDTHS if width <= widest]
    if wanted not in valid:
        raise InputError(
            f"this processor has no vectors of {wanted} doubles (valid: {', '.join(valid)})"
        )
    features = known.flatten()
    if (
        widest == _WIDEST
    ):  # without this LLVM splits 512-bit vectors on processors that prefer narrower ones
        features += ",-prefer-256-bit"
    return Target(
        llvm().get_process_triple(), llvm().get_host_cpu_name(), features, int(wanted)
    )


@cache
def llvm() -> Any:
    """LLVM, ready for the processor at hand."""
    with extra("fast"):
        import llvmlite.binding

    llvmlite.binding.initialize_native_target()
    llvmlite.binding.initialize_native_asmprinter()
    return llvmlite.binding


def compiles() -> bool:
    """Whether machine code can be made here."""
    try:
        llvm()
    except MissingExtraError:
        return False
    return True


def object_code(text: str, target: Target) -> bytes:
    """Machine code of a module; no optimiser runs over the text, since programs leave it nothing to find."""
    machine = target.machine()
    try:
        module = llvm().parse_assembly(text, llvm().create_context())
    except RuntimeError as error:
        raise EchelonError(f"LLVM does not accept a kernel: {error}") from None
    module.triple = target.triple
    module.data_layout = str(machine.target_data)
    code: bytes = machine.emit_object(module)
    return code


class Library:
    """Object code loaded into this process."""

    def __init__(self, code: bytes, target: Target) -> None:
        _know_library_functions()
        # in the global context: one of our own could be collected before the engine, which would then crash
        self._engine = llvm().create_mcjit_compiler(
            llvm().parse_assembly(""), target.machine()
        )
        self._engine.add_object_file(llvm().ObjectFileRef.from_data(code))
        self._engine.finalize_object()

    def function(self, name: str, arguments: Sequence[Any]) -> Any:
        """A function of the library; calling it lets other Python threads run."""
        call = ctypes.CFUNCTYPE(None, *arguments)(self.address(name))
        call.library = self  # type: ignore[attr-defined]  # the code lives as long as anyone can call it
        return call

    def address(self, name: str) -> int:
        """Where a function is, for other compiled code; it lives as long as the library."""
        address: int = self._engine.get_function_address(name)
        if not address:
            raise EchelonError(f"the object code has no function '{name}'")
        return address


@cache
def _know_library_functions() -> None:
    """Tell LLVM where the C library's functions are; on some systems it does not find them by itself."""
    names = [None, ctypes.util.find_library("m"), ctypes.util.find_library("c")]
    if sys.platform == "win32":
        names = ["ucrtbase", "msvcrt"]
    for function in _LIBRARY_FUNCTIONS:
        for name in dict.fromkeys(names):
            try:
                found = getattr(ctypes.CDLL(name), function)
            except (OSError, AttributeError):
                continue
            llvm().add_symbol(function, ctypes.cast(found, ctypes.c_void_p).value)
            break


_MAGIC = b"echelon object code 1\n"
MOST_ENTRIES = 1000
"""Files of object code in the cache; the oldest go first."""
_VARIABLE = "ECHELON_CACHE"


def cached_object(identity: str, text: str, make: Callable[[], bytes]) -> bytes:
    """Object code from the cache, or made and stored there."""
    folder = cache_folder()
    if folder is None:
        return make()
    key = hashlib.sha256(f"{identity}\n{text}".encode()).hexdigest()
    path = folder / f"{key}.bin"
    stored = _stored(path, key)
    if stored is not None:
        return stored
    code = make()
    _store(path, key, code)
    return code


def cache_folder() -> Path | None:
    """Where object code is kept: ``ECHELON_CACHE`` (empty: nowhere) or the user's cache folder; None if not safe."""
    chosen = os.environ.get(_VARIABLE)
    if chosen == "":
        return None
    if chosen is None:
        from platformdirs import user_cache_path

        folder = user_cache_path("echelon", appauthor=False) / "objects"
    else:
        folder = Path(chosen)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        problem = _unsafe(folder.stat())
    except OSError as error:
        problem = error.strerror or str(error)
    if problem is None:
        return folder
    text = f"compiled code is not kept: {folder}: {problem}; set {_VARIABLE} to a folder of your own, or to nothing"
    warnings.warn(text, RuntimeWarning, stacklevel=2)
    return None


def _unsafe(found: os.stat_result) -> str | None:
    """Why code from a folder or file must not be trusted, if there is a reason."""
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
        return "it is neither a file nor a folder"
    if os.name != "posix":
        return None  # the user's own folders are protected by the system's access lists
    if found.st_uid != os.geteuid():
        return "it belongs to another user"
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return "others can write to it"
    return None


def _stored(path: Path, key: str) -> bytes | None:
    """The code in an entry, if the entry is whole and was made for this key."""
    try:
        with open(path, "rb", opener=_without_links) as stream:
            if _unsafe(os.fstat(stream.fileno())) is not None:
                return None
            content = stream.read()
    except OSError:
        return None
    head = _MAGIC + key.encode() + b"\n"
    digest, code = content[len(head) : len(head) + 32], content[len(head) + 32 :]
    whole = content.startswith(head) and hashlib.sha256(code).digest() == digest
    return code if whole else None


def _without_links(path: str, flags: int) -> int:
    """Open a file itself, never what a symbolic link leads to, and wait for no one at the other end of a pipe."""
    if os.path.islink(path):  # where the system has no such flag
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), path)
    return os.open(
        path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    )


def _store(path: Path, key: str, code: bytes) -> None:
    """Write an entry; without room or permission there is none, and the code is made again next time."""
    try:
        if os.path.lexists(path) and not stat.S_ISREG(path.lstat().st_mode):
            path.unlink()  # a link or pipe, through which code would be written to another place
        write_atomically(
            path,
            _MAGIC + key.encode() + b"\n" + hashlib.sha256(code).digest() + code,
            private=True,
        )
    except (InputError, OSError) as error:
        warnings.warn(
            f"compiled code is not kept: {error}", RuntimeWarning, stacklevel=2
        )
        return
    with suppress(OSError):  # another process may remove entries at the same time
        if len(os.listdir(path.parent)) > MOST_ENTRIES:
            entries = sorted(
                path.parent.glob("*.bin"), key=lambda entry: entry.stat().st_mtime
            )
            for old in entries[:-MOST_ENTRIES]:
                old.unlink(missing_ok=True)
