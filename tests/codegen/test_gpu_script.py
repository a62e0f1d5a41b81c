"""``benchmarks/gpu.py`` says what there is; with a device that the processor plays, it compares kernels."""

from __future__ import annotations

import ctypes
import json
import runpy
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import echelon as ec
from echelon.codegen.source import generate
from support.generated_code import compiled
from support.paths import ROOT, TESTS
from support.system_tools import tool

SCRIPT = ROOT / "benchmarks/gpu.py"

DRIVER = """
#include <cstdlib>
#include <cstring>
#include "{header}"
#include "{source}"
typedef unsigned long long Place;
extern "C" {{
int cuInit(unsigned) {{ return 0; }}
int cuDeviceGet(int* device, int) {{ *device = 0; return 0; }}
int cuDeviceGetName(char* name, int, int) {{ strcpy(name, "processor"); return 0; }}
int cuDeviceGetAttribute(int* value, int which, int) {{ *value = which == 75 ? 9 : 0; return 0; }}
int cuDevicePrimaryCtxRetain(void** context, int) {{ *context = nullptr; return 0; }}
int cuCtxSetCurrent(void*) {{ return 0; }}
int cuCtxSynchronize() {{ return 0; }}
int cuModuleLoadData(void** loaded, const char*) {{ *loaded = nullptr; return 0; }}
int cuModuleGetFunction(void** kernel, void*, const char*) {{ *kernel = nullptr; return 0; }}
int cuMemAlloc_v2(Place* place, size_t size) {{ *place = (Place)malloc(size); return 0; }}
int cuMemFree_v2(Place place) {{ free((void*)place); return 0; }}
int cuMemcpyHtoD_v2(Place to, const void* from, size_t size) {{ memcpy((void*)to, from, size); return 0; }}
int cuMemcpyDtoH_v2(void* to, Place from, size_t size) {{ memcpy(to, (void*)from, size); return 0; }}
int cuLaunchKernel(void*, unsigned blocks, unsigned, unsigned, unsigned threads, unsigned, unsigned, unsigned, void*,
                   void** packed, void*)
{{
    const long long count = *(long long*)packed[0];
    launch(blocks, threads, [&] {{
        arm_gravity_kernel(count, *(double**)packed[1], *(double**)packed[2], *(double**)packed[3]);
        {fault}
    }});
    return 0;
}}
}}
"""


@pytest.mark.parametrize(
    ("fault", "right"), [("", True), ("(*(double**)packed[3])[1] += 1e-6;", False)]
)
def test_a_device_is_driven_and_judged(fault: str, right: bool, tmp_path: Path) -> None:
    base = ec.base_parameters(ec.load(ROOT / "examples/double_pendulum.yaml"))
    source = generate(base, "cuda", ["gravity"], name="arm")
    (tmp_path / "arm.cu").write_text(source["arm.cu"])
    header = TESTS / "support/cuda_on_cpu.hpp"
    (tmp_path / "driver.cpp").write_text(
        DRIVER.format(header=header, source="arm.cu", fault=fault)
    )
    library = tmp_path / "driver.so"
    command = [
        tool("g++"),
        "-O1",
        "-shared",
        "-fPIC",
        str(tmp_path / "driver.cpp"),
        "-o",
        str(library),
    ]
    gpu = SimpleNamespace(**runpy.run_path(str(SCRIPT)))
    device = gpu.Device(compiled(command, library))
    assert (device.name, device.architecture) == ("processor", "compute_90")
    run = gpu.compared(
        device, ctypes.c_void_p(), "arm", source.functions[0], "double", 1000
    )
    assert run.right is right


def test_it_says_what_there_is() -> None:
    command = [sys.executable, str(SCRIPT), "--json", "--samples", "1000"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["device"]
    assert "compiled" in report or report["nvrtc"] is False
