"""What a process has used of the machine."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from cvdgs.core.runtime import resources
from cvdgs.core.runtime.resources import peak_memory_mb

CHILD = """
from cvdgs.core.runtime.resources import peak_memory_mb
block = bytearray({0} << 20)
block[::4096] = bytes([1]) * len(block[::4096])
del block
print(peak_memory_mb())
"""


def peak_of_child(megabytes: int) -> int:
    result = subprocess.run([sys.executable, "-c", CHILD.format(megabytes)], capture_output=True, text=True, check=True)
    return int(result.stdout)


@pytest.mark.skipif(peak_memory_mb() is None, reason="this system does not say")
def test_the_peak_is_that_of_the_process_even_after_it_gave_memory_back() -> None:
    assert 190 <= peak_of_child(200) - peak_of_child(0) <= 215


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a process does not take over its parent's peak")
def test_the_peak_is_not_that_of_the_process_that_started_it() -> None:
    block = bytearray(600 << 20)
    block[::4096] = bytes([1]) * len(block[::4096])
    assert (peak_memory_mb() or 0) > 600
    assert peak_of_child(0) < 200


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has this file")
def test_a_sandbox_that_does_not_tell_the_peak_costs_no_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "status").write_text("Name:\tpython\nVmRSS:\t1024 kB\n")
    monkeypatch.setattr(resources, "_STATUS", tmp_path / "status")
    assert (peak_memory_mb() or 0) > 10
