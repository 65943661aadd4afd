"""What the worker makes of faults that are the machine's."""

import pytest
import torch
import warp as wp

from cvdgs.core.worker import is_out_of_memory

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


@pytest.mark.parametrize("error", [RuntimeError("the prototype failed"), ValueError("out of memory"), KeyError("a")])
def test_other_errors_are_not_taken_for_it(error):
    assert not is_out_of_memory(error)


def test_torchs_own_words_on_a_gpu_are_understood():
    assert is_out_of_memory(torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB."))
