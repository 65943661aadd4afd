"""A Blender that is told how many processors to use keeps no more of them busy."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from cvdgs.cvdgs_addon.worker_process import limit_cpu_affinity

pytestmark = pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="the system cannot restrict a process")
CORE = Path(__file__).resolve().parents[2] / "core"
RENDER = """
import json, os, sys, time
sys.path.insert(0, sys.argv[1])
import bootstrap
bootstrap.load()
from cvdgs.cvdgs_addon.worker_process import limit_cpu_affinity
allowed = os.sched_getaffinity(0)
with limit_cpu_affinity(1):
    import bpy
scene = bpy.context.scene
scene.render.engine = "CYCLES"
scene.cycles.samples, scene.cycles.use_denoising = 256, False
scene.render.resolution_x = scene.render.resolution_y = 128
scene.render.threads_mode, scene.render.threads = "FIXED", 1
wall, processor = time.perf_counter(), time.process_time()
bpy.ops.render.render()
wall, processor = time.perf_counter() - wall, time.process_time() - processor
masks = [os.sched_getaffinity(int(thread)) == allowed for thread in os.listdir("/proc/self/task")]
print("found " + json.dumps({"wall": wall, "processor": processor, "free": all(masks)}), flush=True)
os._exit(0)
"""


def test_fewer_processors_are_seen_inside_and_all_of_them_afterwards():
    allowed = os.sched_getaffinity(0)
    with limit_cpu_affinity(1):
        assert len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == allowed


@pytest.mark.parametrize("processors", [0, 10_000])
def test_no_number_and_a_large_one_leave_them_all(processors):
    allowed = os.sched_getaffinity(0)
    with limit_cpu_affinity(processors):
        assert os.sched_getaffinity(0) == allowed


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="there is only one processor")
def test_a_render_with_one_thread_keeps_one_processor_busy():
    command = [sys.executable, "-c", RENDER, str(CORE)]
    output = subprocess.run(command, capture_output=True, text=True, timeout=120).stdout
    (line,) = [line for line in output.splitlines() if line.startswith("found ")]
    found = json.loads(line.removeprefix("found "))
    assert found["free"]
    assert found["processor"] < 1.3 * found["wall"]
