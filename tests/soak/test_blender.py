"""Fifty runs in one Blender: started, watched with pictures, loaded, removed. The worker is a stand-in.

What a worker holds ends with its process; `test_worker.py` looks at the worker's own functions.
"""

from __future__ import annotations

import sys
import textwrap

import bpy
import numpy as np
import pytest

from cvdgs.cvdgs_addon import making
from cvdgs.cvdgs_addon.activity import ACTIVITY
from cvdgs.cvdgs_addon.background import State
from cvdgs.cvdgs_addon.batch.pixels import write_picture
from cvdgs.cvdgs_addon.scene.splats import is_splats

from ..addon.interpreters import finishing
from ..addon.waiting import finished
from .measure import repeat

ROUNDS, WARM_UP = 50, 10
GROWTH = 0.1  # MiB a run; the Gaussians of a run alone are 0.3

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(1200),
    pytest.mark.skipif(sys.platform != "linux", reason="looks at this process in /proc"),
]


def data_blocks() -> dict[str, int]:
    """How many of each kind the file has."""
    kinds = [name for name in dir(bpy.data) if isinstance(getattr(bpy.data, name), bpy.types.bpy_prop_collection)]
    return {name: len(getattr(bpy.data, name)) for name in kinds}


def test_runs_that_are_loaded_and_removed_leave_nothing_in_blender(capture, worker, run_folder, tmp_path):
    picture = tmp_path / "picture.png"
    write_picture(picture, np.full((90, 120, 3), 128, np.uint8))
    show = f'for _ in range(3): emit("preview", file={str(picture)!r})\n'
    worker(show + textwrap.dedent(finishing(run_folder)))
    capture.cvdgs.run.start_over = True
    blocks = []

    def make_load_and_remove(_number: int) -> None:
        making.start_run(capture)
        job = finished(making.JOB)
        assert job.state is State.DONE, job.problem
        (splats,) = (candidate for candidate in capture.objects if is_splats(candidate))
        (collection,) = splats.users_collection
        bpy.data.batch_remove([collection, *collection.all_objects])
        bpy.ops.outliner.orphans_purge(do_recursive=True)
        blocks.append(data_blocks())

    course = repeat(make_load_and_remove, ROUNDS, WARM_UP)
    print(course)
    assert blocks[-1] == blocks[WARM_UP]
    assert {(held.handles, held.threads) for held in course.rounds} == {
        (course.rounds[0].handles, course.rounds[0].threads)
    }
    assert course.growth < GROWTH
    assert ACTIVITY.running(making.JOB) is None
