"""Tests of the device that a job computes on."""

from __future__ import annotations

import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.runtime.devices import choose_device, missing_for_cuda
from cvdgs.core.settings import DEVICES


@pytest.mark.parametrize(("has_cuda", "chosen"), [(False, "cpu"), (True, "cuda")])
def test_a_cuda_device_is_taken_where_there_is_one(has_cuda, chosen):
    assert choose_device("auto", has_cuda=has_cuda) == chosen


@pytest.mark.parametrize("asked", ["cpu", "cuda"])
def test_a_device_that_is_asked_for_is_taken(asked):
    assert choose_device(asked, has_cuda=True) == asked


def test_cuda_where_there_is_none_is_refused_with_the_name_of_the_setting():
    with pytest.raises(InputError, match="device: no CUDA device found - use device cpu"):
        choose_device("cuda", has_cuda=False, where="device")


def test_an_unknown_device_is_refused_with_those_there_are():
    with pytest.raises(InputError, match=f"--device: 'tpu' is not known - use {', '.join(DEVICES)}"):
        choose_device("tpu", has_cuda=True)


@pytest.mark.parametrize(
    ("driver", "toolkit", "words"),
    [
        ((12, 8), (13, 4), "supports CUDA 12.8, and 13.0 is needed"),
        ([12, 8], [13, 4], "supports CUDA 12.8, and 13.0 is needed"),
        ((13, 0), (13, 4), "no CUDA device found"),
        (None, (13, 4), "no CUDA device found"),
        (None, None, "no CUDA device found"),
    ],
)
def test_what_is_missing_is_said_of_the_driver_where_it_is_too_old(driver, toolkit, words):
    assert missing_for_cuda(driver, toolkit).endswith(words)
