"""A driver that Warp cannot use, stood in for by a library of its name: said in one line, and done without."""

import os
import shutil
import subprocess
import sys

import pytest

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.demo import SHOWROOM

# Warp looks functions up by name through the driver's own function for that.
DRIVER = """
#include <string.h>
static int version(int *v) { *v = VERSION; return 0; }
static int init(unsigned flags) { return INIT; }
static int count(int *n) { *n = 1; return 0; }
int cuGetProcAddress(const char *name, void **found, int version_, unsigned long long flags) {
    *found = !strcmp(name, "cuDriverGetVersion") ? (void *)version
        : !strcmp(name, "cuInit") ? (void *)init : !strcmp(name, "cuDeviceGetCount") ? (void *)count : 0;
    return *found ? 0 : 500;
}
"""
COMPILER = shutil.which("cc")

pytestmark = pytest.mark.skipif(COMPILER is None or sys.platform != "linux", reason="the stand-in has to be compiled")


@pytest.fixture
def driver(tmp_path):
    def make(version: int, init: int = 0) -> dict[str, str]:
        source, folder = tmp_path / "driver.c", tmp_path / "driver"
        folder.mkdir()
        source.write_text(DRIVER)
        definitions = [f"-DVERSION={version}", f"-DINIT={init}"]
        library = str(folder / "libcuda.so.1")
        subprocess.run([COMPILER, "-shared", "-fPIC", *definitions, str(source), "-o", library], check=True)
        return {**os.environ, "LD_LIBRARY_PATH": str(folder), "CVDGS_PYTHON": sys.executable}

    return make


def script(environment: dict[str, str], *options: str) -> subprocess.CompletedProcess:
    command = [sys.executable, str(ROOT / "scripts" / "run.py"), *options]
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=240)


@pytest.mark.parametrize(
    ("version", "init", "what"),
    [
        (12080, 0, "the NVIDIA driver supports CUDA 12.8, and 13.0 is needed"),
        (11040, 0, "no CUDA device found"),
        (13040, 100, "no CUDA device found"),
    ],
    ids=["old", "very old", "no card"],
)
def test_a_driver_that_cannot_be_used_is_one_line(driver, tmp_path, version, init, what):
    options = (str(SHOWROOM), "--out", str(tmp_path / "out"), "--no-blend", "--device", "cuda")
    result = script(driver(version, init), *options)
    assert result.returncode == 2
    assert f"--device: {what} - use --device cpu, or check the driver and torch's build" in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_runs_do_without_it_and_the_doctor_says_why(driver, tmp_path):
    environment = driver(12080)
    options = ("--max-size", "64", "--iterations", "5", "--gaussians", "500", "--no-blend")
    assert script(environment, str(SHOWROOM), "--out", str(tmp_path / "out"), *options).returncode == 0
    told = script(environment, "--doctor").stdout
    assert "the NVIDIA driver supports CUDA 12.8, and 13.0 is needed; the CPU is used" in told
