"""Object code: made by LLVM from text, and made callable in this process."""

from __future__ import annotations

import ctypes
import ctypes.util
import sys
from collections.abc import Sequence
from functools import cache
from typing import Any

import llvmlite.binding as llvm

from echelon.errors import EchelonError
from echelon.machine.target import Target

_LIBRARY_FUNCTIONS = ("sin", "cos", "exp", "log", "tanh", "atan", "memcpy", "memset")


def object_code(text: str, target: Target, level: int = 1) -> bytes:
    """Machine code of a module.

    Parameters
    ----------
    text : str
        LLVM's textual representation.
    target : Target
    level : int
        The code generator's effort.  No optimiser runs over the text: the programs leave it nothing to find.

    Raises
    ------
    EchelonError
        If LLVM does not accept the text, which is a mistake of ours.
    """
    machine = target.machine(level)
    try:
        module = llvm.parse_assembly(text, llvm.create_context())
    except RuntimeError as error:
        raise EchelonError(f"LLVM does not accept a kernel: {error}") from None
    module.triple = target.triple
    module.data_layout = str(machine.target_data)
    code: bytes = machine.emit_object(module)
    return code


class Library:
    """Object code loaded into this process.

    Parameters
    ----------
    code : bytes
    target : Target
    """

    def __init__(self, code: bytes, target: Target) -> None:
        _know_library_functions()
        # in the global context: one of our own could be collected before the engine, which would then crash
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target.machine(1))
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        self._engine.finalize_object()

    def function(self, name: str, arguments: Sequence[Any]) -> Any:
        """A function of the library; calling it lets other Python threads run.

        Parameters
        ----------
        name : str
        arguments : sequence of ctypes types

        Raises
        ------
        EchelonError
            If the library has no such function.
        """
        call = ctypes.CFUNCTYPE(None, *arguments)(self.address(name))
        call.library = self  # type: ignore[attr-defined]  # the code lives as long as anyone can call it
        return call

    def address(self, name: str) -> int:
        """Where a function is, for other compiled code; it lives as long as the library.

        Raises
        ------
        EchelonError
            If the library has no such function.
        """
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
            llvm.add_symbol(function, ctypes.cast(found, ctypes.c_void_p).value)
            break
