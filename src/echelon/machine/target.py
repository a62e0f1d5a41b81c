"""The processor that machine code is made for, and how many doubles its vectors hold."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cache

import llvmlite
import llvmlite.binding as llvm

from echelon.errors import InputError

_WIDTHS = (2, 4, 8)
_WIDEST = _WIDTHS[-1]


@dataclass(frozen=True)
class Target:
    """A processor.

    Attributes
    ----------
    triple, cpu, features : str
        As LLVM names them.
    lanes : int
        Samples that one vector holds: 8 (AVX-512), 4 (AVX2) or 2 (NEON, SSE2).
    """

    triple: str
    cpu: str
    features: str
    lanes: int

    @property
    def registers(self) -> int:
        """Vector registers."""
        return 32 if self.lanes == _WIDEST or self.triple.startswith(("aarch64", "arm64")) else 16

    @property
    def identity(self) -> str:
        """Everything that object code depends on beside its source."""
        version = ".".join(map(str, llvm.llvm_version_info))
        return f"{self.triple} {self.cpu} {self.features} {self.lanes} llvmlite {llvmlite.__version__} LLVM {version}"

    def machine(self, level: int) -> llvm.TargetMachine:
        """LLVM's code generator for this processor.

        Parameters
        ----------
        level : int
            Effort, 0 to 3.  Programs here are straight lines in good order, so 1 is as good as 3 and much faster.
        """
        _initialise()
        target = llvm.Target.from_triple(self.triple)
        return target.create_target_machine(
            cpu=self.cpu, features=self.features, opt=level, reloc="pic", codemodel="jitdefault"
        )


@cache
def host(lanes: int | None = None) -> Target:
    """The processor at hand.

    Parameters
    ----------
    lanes : int, optional
        Narrower vectors than the processor has, for comparison; the widest if omitted.  The environment variable
        ``ECHELON_LANES`` sets the default.

    Raises
    ------
    InputError
        If the processor has no such vectors.
    """
    _initialise()
    known = llvm.get_host_cpu_features()
    # without fused multiply-add every reduction of an angle would call a library, so such vectors are not worth having
    widest = 8 if known.get("avx512f") else 4 if known.get("avx2") and known.get("fma") else 2
    wanted = str(lanes or os.environ.get("ECHELON_LANES") or widest)
    valid = [str(width) for width in _WIDTHS if width <= widest]
    if wanted not in valid:
        raise InputError(f"this processor has no vectors of {wanted} doubles (valid: {', '.join(valid)})")
    features = known.flatten()
    if widest == _WIDEST:  # without this LLVM splits 512-bit vectors on processors that prefer narrower ones
        features += ",-prefer-256-bit"
    return Target(llvm.get_process_triple(), llvm.get_host_cpu_name(), features, int(wanted))


@cache
def _initialise() -> None:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
