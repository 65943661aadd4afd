"""Which device a job computes on: what was asked for, checked against what the machine has. Standard library only."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence

from ..errors import InputError
from ..settings import DEVICES

NO_DEVICE = "no CUDA device found"
TORCH_WITHOUT_CUDA = "the installed torch cannot use the CUDA device: it is a build without CUDA"


def missing_for_cuda(driver: Sequence[int] | None, toolkit: Sequence[int] | None) -> str:
    """Why there is no CUDA device, as a phrase.

    Args:
        driver: (major, minor) version of CUDA that the installed driver supports; None where there is none.
        toolkit: the version that the library is built with. Drivers work with all of their own major version.
    """
    if driver and toolkit and driver[0] < toolkit[0]:
        return f"the NVIDIA driver supports CUDA {driver[0]}.{driver[1]}, and {toolkit[0]}.0 is needed"
    return NO_DEVICE


def choose_device(asked: str, *, has_cuda: bool, where: str = "--device", missing: str = NO_DEVICE) -> str:
    """The device, "cpu" or "cuda".

    Args:
        asked: one of `DEVICES`; "auto" takes a CUDA device where there is one.
        has_cuda: whether what is to compute finds a CUDA device.
        where: the name of the setting, for the message.
        missing: why there is none, likewise.

    Raises:
        InputError: there is no such device.
    """
    if asked not in DEVICES:
        raise InputError(f"'{asked}' is not known", where=where, remedy=f"use {', '.join(DEVICES)}")
    if asked == "cuda" and not has_cuda:
        raise InputError(missing, where=where, remedy=f"use {where} cpu, or check the driver and torch's build")
    if asked == "auto":
        return "cuda" if has_cuda else "cpu"
    return asked


# How the system, Warp, torch and CUDA name what is not a defect of ours, in the text of an error.
_NO_MEMORY = re.compile(
    r"failed to allocate \d+ bytes|out of memory|can(?:'t|not) allocate memory|bad_alloc|can't start new thread"
    r"|failed to map segment",
    re.IGNORECASE,
)
_ON_GRAPHICS_CARD = re.compile(r"cuda", re.IGNORECASE)
_CUDA_FAILED = re.compile(r"cuda ?error|cuda driver", re.IGNORECASE)
WHY_KILLED = "most likely because the machine ran out of memory"
AFTER_KILLED = "close other programs or give a smaller --max-size, then run again"
"""Of a process that something else ended by force: the reason, and what to do."""
_OURS = __name__.partition(".")[0] + "."  # what the names of our modules start with


def is_out_of_memory(error: BaseException) -> bool:
    """Whether an allocation failed, on the CPU or on a GPU; the system, Warp and torch say so in an error's text."""
    if isinstance(error, MemoryError):
        return True
    reasons = (error, error.__cause__)  # Warp names that of a library that cannot be loaded there
    return any(isinstance(e, RuntimeError | OSError | ImportError) and bool(_NO_MEMORY.search(str(e))) for e in reasons)


def explain_fault(
    error: Exception, *, smaller: str = "give fewer or smaller photographs, or a smaller --max-size"
) -> str:
    """One line about a fault of the machine, with a remedy; "" for a defect of ours.

    Args:
        smaller: the remedy where memory does not suffice.
    """
    if is_out_of_memory(error):
        if _ON_GRAPHICS_CARD.search(str(error)):
            return f"the graphics card is out of memory - {smaller}, or use --device cpu"
        return f"the machine is out of memory - {smaller}"
    if isinstance(error, ImportError) and error.name and not error.name.startswith(_OURS):
        what = str(error).splitlines()[0]
        return f"{sys.executable} lacks a package ({what}) - 'scripts/run.py --doctor' shows which and how to get it"
    if isinstance(error, OSError):
        name = f"{error.filename}: " if error.filename else ""
        return f"{name}{error.strerror or error} - free space or check the permissions, then run again"
    if isinstance(error, RuntimeError) and _CUDA_FAILED.search(str(error)):
        what = str(error).splitlines()[0]
        return f"the graphics card or its driver failed ({what}) - update the driver, or use --device cpu"
    return ""
