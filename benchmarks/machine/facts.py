"""The processor as LLVM sees it, and the compilers of the anchors."""

from __future__ import annotations

import os
from datetime import UTC, datetime
from functools import cache
from typing import Any

from anchors.build import UnavailableError, compiler_version, eigen_version
from anchors.figaroh_tool import VERSION as FIGAROH

# the instruction sets that decide how fast vectors of doubles are
_SETS = (
    "avx512f",
    "avx512dq",
    "avx512vl",
    "avx2",
    "fma",
    "sse4.2",
    "neon",
    "sve",
    "sve2",
)


@cache
def has_avx512() -> bool:
    return "avx512f" in instruction_sets()


@cache
def instruction_sets() -> tuple[str, ...]:
    """Those of the known sets that this processor has."""
    import llvmlite.binding as llvm

    known = llvm.get_host_cpu_features()
    return tuple(name for name in _SETS if known.get(name))


def facts(repeats: int) -> dict[str, Any]:
    """Date, processor, LLVM and compilers."""
    import llvmlite
    import llvmlite.binding as llvm

    from echelon.compute.machine.target import host

    return {
        "date": datetime.now(UTC).date().isoformat(),
        "rounds": repeats,
        "cores": os.cpu_count(),
        "cpu": llvm.get_host_cpu_name(),
        "instruction_sets": list(instruction_sets()),
        "lanes": host().lanes,
        "llvm": f"llvmlite {llvmlite.__version__}, LLVM {'.'.join(map(str, llvm.llvm_version_info))}",
        "compilers": _compilers(),
        "tools": {"figaroh": FIGAROH} | _eigen(),
    }


def _compilers() -> dict[str, str]:
    found = {}
    for language in ("c++", "c"):
        try:
            found[language] = compiler_version(language)
        except UnavailableError as error:
            found[language] = str(error)
    return found


def _eigen() -> dict[str, str]:
    try:
        return {"eigen": eigen_version()}
    except UnavailableError:
        return {}
