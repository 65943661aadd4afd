"""What the worker makes of faults that are the machine's."""

import errno
import importlib
import os
from pathlib import Path

import pytest
import torch
import warp as wp

from cvdgs.core.errors import InputError
from cvdgs.core.pipeline.run import run
from cvdgs.core.runtime.devices import explain_fault, is_out_of_memory
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.settings import Settings

MORE_THAN_THERE_IS = 1 << 46  # bytes


@pytest.mark.parametrize(
    "allocate",
    [
        lambda: wp.empty((MORE_THAN_THERE_IS >> 30, 1 << 30), dtype=wp.uint8, device="cpu"),
        lambda: torch.empty(MORE_THAN_THERE_IS, dtype=torch.uint8),
        lambda: bytearray(MORE_THAN_THERE_IS),
    ],
    ids=["warp", "torch", "python"],
)
def test_an_allocation_that_fails_is_told_from_a_defect(allocate):
    with pytest.raises((RuntimeError, MemoryError)) as caught:
        allocate()
    assert is_out_of_memory(caught.value)


def unloadable(reason: str) -> RuntimeError:
    error = RuntimeError("Failed to load the shared library 'warp.so'")
    error.__cause__ = OSError(reason)
    return error


@pytest.mark.parametrize(
    "error",
    [
        OSError(errno.ENOMEM, os.strerror(errno.ENOMEM), "torch"),
        RuntimeError("can't start new thread"),
        RuntimeError("std::bad_alloc"),
        ImportError("libtorch.so: cannot allocate memory in static TLS block"),
        unloadable("warp.so: failed to map segment from shared object"),
    ],
    ids=["system", "thread", "C++", "import", "library"],
)
def test_what_fails_for_want_of_memory_says_so(error):
    assert is_out_of_memory(error)
    assert explain_fault(error).startswith("the machine is out of memory - ")


@pytest.mark.parametrize(
    "error",
    [
        unloadable("warp.so: no such file"),
        RuntimeError("the program failed"),
        ValueError("out of memory"),
        KeyError("a"),
    ],
)
def test_other_errors_are_not_taken_for_it(error):
    assert not is_out_of_memory(error)


def test_an_environment_that_lacks_a_package_is_no_defect():
    with pytest.raises(ImportError) as caught:
        importlib.import_module("a_package_that_is_not_installed")
    assert "'scripts/run.py --doctor' shows which" in explain_fault(caught.value)


def test_a_module_of_ours_that_is_missing_is_a_defect():
    with pytest.raises(ImportError) as caught:
        importlib.import_module("cvdgs.core.a_module_that_is_not_there")
    assert explain_fault(caught.value) == ""


def test_torchs_own_words_on_a_gpu_are_understood():
    assert is_out_of_memory(torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB."))


@pytest.mark.parametrize(
    "error",
    [
        torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB."),
        RuntimeError("Failed to allocate 4194304 bytes on device 'cuda:0'"),
    ],
    ids=["torch", "warp"],
)
def test_a_full_graphics_card_is_told_from_a_full_machine(error):
    assert explain_fault(error).startswith("the graphics card is out of memory - ")
    assert "--device cpu" in explain_fault(error)
    assert explain_fault(MemoryError()).startswith("the machine is out of memory - ")


@pytest.mark.parametrize(
    "text",
    [
        "CUDA error 700 detected on device cuda:0: an illegal memory access was encountered",
        "CUDA error: no kernel image is available for execution on the device\nCUDA kernel errors might be reported",
        "The NVIDIA driver on your system is too old (found version 11040): CUDA driver version is insufficient",
    ],
    ids=["warp", "torch", "driver"],
)
def test_a_driver_that_fails_is_one_line_that_names_the_way_without_it(text):
    explanation = explain_fault(RuntimeError(text))
    assert text.splitlines()[0] in explanation
    assert explanation.endswith("update the driver, or use --device cpu")
    assert len(explanation.splitlines()) == 1


def test_a_mistake_of_ours_with_devices_is_not_blamed_on_the_driver():
    text = "Expected all tensors to be on the same device, but found at least two devices, cuda:0 and cpu!"
    assert explain_fault(RuntimeError(text)) == ""


def test_a_fault_of_the_disk_names_the_file():
    explanation = explain_fault(OSError(errno.ENOSPC, "No space left on device", "out/splats.ply"))
    assert explanation.startswith("out/splats.ply: No space left on device - free space")


@pytest.mark.skipif(wp.is_cuda_available(), reason="needs a machine without CUDA")
def test_cuda_where_there_is_none_is_refused_before_anything_is_read():
    with pytest.raises(InputError, match="--device: no CUDA device found - use --device cpu"):
        run(Settings("no capture", "out", device="cuda"), Path("out"), Reporter())
