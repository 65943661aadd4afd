"""What a process has used of the machine."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from cvdgs.core.runtime import resources
from cvdgs.core.runtime.process import Job
from cvdgs.core.runtime.resources import CARDS_VARIABLE, available_processors, card_names, peak_memory_mb, this_machine
from cvdgs.core.runtime.supervisor import finish

LIMITS = {
    "memory_v2": "memory.max",
    "memory_v1": "memory/memory.limit_in_bytes",
    "cpu_v2": "cpu.max",
    "quota_v1": "cpu/cpu.cfs_quota_us",
    "period_v1": "cpu/cpu.cfs_period_us",
}
"""Where Linux states a container's limits, by the version of its control groups."""

CHILD = """
from cvdgs.core.runtime.resources import peak_memory_mb
block = bytearray({0} << 20)
block[::4096] = bytes([1]) * len(block[::4096])
del block
print(peak_memory_mb())
"""


FRAGMENTED = """
from pathlib import Path
from cvdgs.core.runtime.resources import return_freed_memory
def resident():
    return int(Path("/proc/self/status").read_text().split("VmRSS:")[1].split()[0]) // 1024
blocks = [b"x" * (64 << 10) for _ in range(3200)]
kept = blocks[::20]
del blocks
before = resident()
return_freed_memory()
print(before - resident(), sum(map(len, kept)))
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


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the allocator decides")
def test_freed_memory_between_blocks_that_are_kept_is_given_back() -> None:
    result = subprocess.run([sys.executable, "-c", FRAGMENTED], capture_output=True, text=True, check=True)
    returned, kept = map(int, result.stdout.split())
    assert returned > 100  # MiB, of the 190 that are free
    assert kept == 160 * (64 << 10)


@pytest.fixture
def container(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., None]:
    """Lets this process see files as a container's limits."""
    monkeypatch.setattr(resources, "_CONTROL_GROUP", tmp_path)

    def limit(**files: str) -> None:
        for name, text in files.items():
            path = tmp_path / LIMITS[name]
            path.parent.mkdir(exist_ok=True)
            path.write_text(f"{text}\n")

    return limit


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere no file tells a container's limit")
@pytest.mark.parametrize("version", ["memory_v2", "memory_v1"])
def test_a_containers_limit_is_all_the_memory_there_is(container, version: str) -> None:
    unlimited = this_machine().memory_mb
    assert unlimited > 100
    container(**{version: str(100 << 20)})
    assert this_machine().memory_mb == 100
    for none in ("max", "no number", str((1 << 63) - 4096)):
        container(**{version: none})
        assert this_machine().memory_mb == unlimited


@pytest.mark.parametrize(
    ("files", "processors"),
    [
        ({"cpu_v2": "200000 100000"}, 2),
        ({"cpu_v2": "150000 100000"}, 2),
        ({"cpu_v2": "5000 100000"}, 1),
        ({"cpu_v2": "99900000 100000"}, 64),
        ({"cpu_v2": "max 100000"}, 64),
        ({"quota_v1": "300000", "period_v1": "100000"}, 3),
        ({"quota_v1": "-1", "period_v1": "100000"}, 64),
        ({"quota_v1": "300000"}, 64),
        ({}, 64),
    ],
)
def test_a_containers_quota_is_all_the_processors_there_are(monkeypatch, container, files, processors: int) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(64)), raising=False)
    container(**files)
    assert available_processors() == this_machine().cores == processors


@pytest.mark.parametrize(("files", "threads"), [({"cpu_v2": "100000 100000"}, "1"), ({}, None)])
def test_a_worker_starts_as_many_threads_as_its_container_may_use(monkeypatch, container, files, threads) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    container(**files)
    program = "import json, os; print(json.dumps({'event': 'result', 'threads': os.environ.get('OMP_NUM_THREADS')}))"
    assert finish(Job([sys.executable, "-c", program]), lambda _: None)["threads"] == threads


@pytest.mark.parametrize(
    ("variable", "names"),
    [
        (None, ["0", "1"]),
        ("1", ["1"]),
        (" 1, 0", ["1", "0"]),
        ("GPU-bb", ["GPU-bb"]),
        ("", []),
        ("-1", []),
        ("1,-1,0", ["1"]),
        ("7,0", []),
    ],
)
def test_graphics_cards_are_those_that_cuda_may_use(monkeypatch, two_cards, variable, names) -> None:
    if variable is not None:
        monkeypatch.setenv(CARDS_VARIABLE, variable)
    machine = this_machine()
    assert machine.gpus == len(names)
    assert card_names(machine.gpus) == names


def test_cards_that_are_asked_for_are_limited_by_those_that_cuda_may_use(monkeypatch) -> None:
    monkeypatch.delenv(CARDS_VARIABLE, raising=False)
    assert card_names(3) == ["0", "1", "2"]
    monkeypatch.setenv(CARDS_VARIABLE, "5,3")
    assert [card_names(count) for count in range(4)] == [[], ["5"], ["5", "3"], ["5", "3"]]
