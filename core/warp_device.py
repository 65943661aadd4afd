"""Which device Warp's kernels run on."""

from __future__ import annotations

import warp as wp

from .devices import choose_device, missing_for_cuda


def choose_warp_device(asked: str, *, where: str = "--device") -> str:
    """The device, "cpu" or "cuda", of one of `DEVICES`; see `choose_device`.

    Raises:
        InputError: there is no such device, or its driver is too old for Warp.
    """
    return choose_device(
        asked,
        has_cuda=wp.is_cuda_available(),
        automatic="cpu",  # the CUDA kernels compile but have not been measured yet, so they run only when asked for
        where=where,
        missing=missing_for_cuda(wp.get_cuda_driver_version(), wp.get_cuda_toolkit_version()),
    )
