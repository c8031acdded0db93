"""What is said of drivers that fail, with a library in the place of OpenCL's."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from tests.rules.sources import CC

# A driver of one device, whose compiler has much to say about every program.
DRIVER = r"""
#include <stdint.h>
#include <string.h>
#define NONE(name) int32_t name(void) { return -1; }
NONE(clCreateKernel) NONE(clReleaseKernel) NONE(clSetKernelArg) NONE(clCreateBuffer)
NONE(clReleaseMemObject) NONE(clEnqueueNDRangeKernel) NONE(clEnqueueMapBuffer)
NONE(clEnqueueUnmapMemObject) NONE(clFinish)
static int thing;
static int32_t give(const void *from, size_t bytes, size_t room, void *out, size_t *size)
{
    if (size)
        *size = bytes;
    if (out && room < bytes)
        return -30;
    if (out)
        memcpy(out, from, bytes);
    return 0;
}
int32_t clGetPlatformIDs(uint32_t room, void **out, uint32_t *count)
{
    *out = &thing;
    *count = 1;
    return 0;
}
int32_t clGetDeviceIDs(void *platform, uint64_t type, uint32_t room, void **out, uint32_t *count)
{
    *out = &thing;
    *count = 1;
    return 0;
}
int32_t clGetDeviceInfo(void *device, uint32_t what, size_t room, void *out, size_t *size)
{
    const uint64_t all = UINT64_MAX;
    const uint32_t little = *(const char *)&(uint16_t){1};
    switch (what) {
    case 0x102b: return give("Sham", 5, room, out, size);
    case 0x102e: return give("FULL_PROFILE", 13, room, out, size);
    case 0x102f: return give("OpenCL 1.2", 11, room, out, size);
    case 0x1026: return give(&little, 4, room, out, size);
    default: return give(&all, room, room, out, size);
    }
}
#define CREATE(name, parameters) void *name parameters { *error = 0; return &thing; }
CREATE(clCreateContext, (void *p, uint32_t n, void *d, void *f, void *u, int32_t *error))
CREATE(clCreateCommandQueue, (void *c, void *d, uint64_t p, int32_t *error))
CREATE(clCreateProgramWithSource, (void *c, uint32_t n, void *t, void *l, int32_t *error))
int32_t clReleaseContext(void *c) { return 0; }
int32_t clReleaseCommandQueue(void *q) { return 0; }
int32_t clReleaseProgram(void *p) { return 0; }
int32_t clBuildProgram(void *p, uint32_t n, void *d, char *o, void *f, void *u) { return -11; }
int32_t clGetProgramBuildInfo(void *p, void *d, uint32_t what, size_t room, void *out, size_t *size)
{
    static char log[2000];
    memset(log, '~', sizeof log - 1);
    memcpy(log, "line 1: no such type", 20);
    return give(log, sizeof log, room, out, size);
}
"""


@pytest.fixture
def driver(tmp_path: Path) -> Path:
    (tmp_path / "driver.c").write_text(DRIVER)
    command = [*CC.split(), "-w", "-shared", "-fPIC", "driver.c", "-o", "driver.so"]
    if subprocess.run(command, cwd=tmp_path, check=False).returncode:
        pytest.skip("optional: the compiler makes no shared libraries")
    return tmp_path / "driver.so"


def test_long_messages_of_the_compiler_are_told(driver, build, tmp_path):
    (tmp_path / "in.pfm").write_bytes(b"PF\n1 1\n-1.0\n" + bytes(12))
    done = subprocess.run([build / "bin" / "oidnDenoise", "-d=opencl", "in.pfm", "-o", "out.pfm"],
                          cwd=tmp_path, text=True, capture_output=True, timeout=60, check=False,
                          env={**os.environ, "LULL_OPENCL_LIBRARY": str(driver)})
    if "without OpenCL" in done.stderr or "cannot be loaded" in done.stderr:
        pytest.skip("optional: the program loads no such library")
    assert done.returncode == 3
    assert "Sham cannot compile the kernels (error -11): line 1: no such type~~~" in done.stderr
