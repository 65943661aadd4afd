"""Which device a job computes on: what was asked for, checked against what the machine has. Standard library only."""

from __future__ import annotations

from .errors import InputError
from .settings import DEVICES


def choose_device(asked: str, *, has_cuda: bool, automatic: str = "cuda", where: str = "--device") -> str:
    """The device, "cpu" or "cuda".

    Args:
        asked: one of `DEVICES`.
        has_cuda: whether the library that is to compute finds a CUDA device.
        automatic: what "auto" takes where there is one.
        where: the name of the setting, for the message.

    Raises:
        InputError: there is no such device.
    """
    if asked not in DEVICES:
        raise InputError(f"'{asked}' is not known", where=where, remedy=f"use {', '.join(DEVICES)}")
    if asked == "cuda" and not has_cuda:
        raise InputError("no CUDA device is found", where=where, remedy=f"use {where} cpu, or check the driver")
    if asked == "auto":
        return automatic if has_cuda else "cpu"
    return asked
