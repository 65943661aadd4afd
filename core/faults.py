"""Faults of the machine - memory, disk, driver, missing packages - told in one line. Standard library only."""

from __future__ import annotations

import re
import sys

# How the system, Warp, torch and CUDA name what is not a defect of ours, in the text of an error.
_NO_MEMORY = re.compile(
    r"failed to allocate \d+ bytes|out of memory|can(?:'t|not) allocate memory|bad_alloc|can't start new thread"
    r"|failed to map segment",
    re.IGNORECASE,
)
_ON_GRAPHICS_CARD = re.compile(r"cuda", re.IGNORECASE)
_CUDA_FAILED = re.compile(r"cuda ?error|cuda driver", re.IGNORECASE)
_OURS = __name__.partition(".")[0] + "."  # what the names of our modules start with


def is_out_of_memory(error: BaseException) -> bool:
    """Whether an allocation failed, on the CPU or on a GPU; the system, Warp and torch say so in an error's text."""
    if isinstance(error, MemoryError):
        return True
    reasons = (error, error.__cause__)  # Warp names that of a library that cannot be loaded there
    return any(isinstance(e, RuntimeError | OSError | ImportError) and bool(_NO_MEMORY.search(str(e))) for e in reasons)


def explain_fault(error: Exception) -> str:
    """One line about a fault of the machine, with what to do; "" for what is none, but a defect of ours."""
    if is_out_of_memory(error):
        smaller = "give fewer or smaller photographs, or a smaller --max-size"
        if _ON_GRAPHICS_CARD.search(str(error)):
            return f"the graphics card's memory is used up - {smaller}, or use --device cpu"
        return f"the memory is used up - {smaller}"
    if isinstance(error, ImportError) and error.name and not error.name.startswith(_OURS):
        what = str(error).splitlines()[0]
        return f"{sys.executable} lacks something ({what}) - 'scripts/run.py --doctor' says what and how to get it"
    if isinstance(error, OSError):
        name = f"{error.filename}: " if error.filename else ""
        return f"{name}{error.strerror or error} - free space or check the permissions, then run again"
    if isinstance(error, RuntimeError) and _CUDA_FAILED.search(str(error)):
        what = str(error).splitlines()[0]
        return f"the graphics card or its driver failed ({what}) - update the driver, or use --device cpu"
    return ""
