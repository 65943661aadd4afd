"""Which device a job computes on: what was asked for, checked against what the machine has. Standard library only."""

from __future__ import annotations

from collections.abc import Sequence

from .errors import InputError
from .settings import DEVICES

NO_DEVICE = "no CUDA device is found"


def missing_for_cuda(driver: Sequence[int] | None, toolkit: Sequence[int] | None) -> str:
    """Why there is no CUDA device, in words.

    Args:
        driver: (major, minor) version of CUDA that the installed driver supports; None where there is none.
        toolkit: the version that the library is built with. Drivers work with all of their own major version.
    """
    if driver and toolkit and driver[0] < toolkit[0]:
        return f"the NVIDIA driver supports CUDA {driver[0]}.{driver[1]}, and {toolkit[0]}.0 is needed"
    return NO_DEVICE


def choose_device(
    asked: str, *, has_cuda: bool, automatic: str = "cuda", where: str = "--device", missing: str = NO_DEVICE
) -> str:
    """The device, "cpu" or "cuda".

    Args:
        asked: one of `DEVICES`.
        has_cuda: whether the library that is to compute finds a CUDA device.
        automatic: what "auto" takes where there is one.
        where: the name of the setting, for the message.
        missing: why there is none, likewise.

    Raises:
        InputError: there is no such device.
    """
    if asked not in DEVICES:
        raise InputError(f"'{asked}' is not known", where=where, remedy=f"use {', '.join(DEVICES)}")
    if asked == "cuda" and not has_cuda:
        raise InputError(missing, where=where, remedy=f"use {where} cpu, or check the driver")
    if asked == "auto":
        return automatic if has_cuda else "cpu"
    return asked
