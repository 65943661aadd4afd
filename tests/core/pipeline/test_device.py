"""Training takes a graphics card that both Warp and torch can use, and a folder for its kernels."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
import torch
import warp as wp

from cvdgs.core.errors import InputError
from cvdgs.core.pipeline.device import choose_warp_device


@pytest.fixture
def libraries_with(monkeypatch):
    def libraries(*, warp: bool, torch_too: bool) -> None:
        monkeypatch.setattr(wp, "is_cuda_available", lambda: warp)
        monkeypatch.setattr(torch.cuda, "is_available", lambda: torch_too)

    return libraries


@pytest.mark.parametrize(
    ("warp", "torch_too", "chosen"), [(True, True, "cuda"), (True, False, "cpu"), (False, False, "cpu")]
)
def test_a_card_is_taken_by_itself_where_both_libraries_can_use_it(libraries_with, warp, torch_too, chosen):
    libraries_with(warp=warp, torch_too=torch_too)
    assert choose_warp_device("auto") == chosen


def test_a_torch_without_cuda_is_named_where_a_card_is_asked_for(libraries_with):
    libraries_with(warp=True, torch_too=False)
    with pytest.raises(InputError, match="--device: the installed torch cannot use the CUDA device"):
        choose_warp_device("cuda")


def test_a_service_without_a_home_for_kernels_is_told_where_to_choose_another_folder(tmp_path):
    home = tmp_path / "no home"
    home.write_text("where a folder should be")
    program = "from cvdgs.core.pipeline.device import choose_warp_device; choose_warp_device('auto')"
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "WARP_CACHE_PATH": str(home / "kernels")}
    ended = subprocess.run([sys.executable, "-c", program], env=variables, capture_output=True, text=True)
    said = ended.stderr.strip().splitlines()[-1]
    assert f"{home}" in said
    assert said.endswith("set WARP_CACHE_PATH to a folder that you can write to")
