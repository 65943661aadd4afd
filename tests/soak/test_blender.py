"""Fifty runs in one Blender: started, watched with pictures, loaded, undone, redone, removed. The worker is a stand-in.

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
from cvdgs.cvdgs_addon.scene.splats import is_splats, layer_names

from ..addon.interpreters import finishing
from ..addon.waiting import finished
from .measure import repeat

ROUNDS, WARM_UP = 50, 10
GROWTH = 0.1  # MiB a run; the Gaussians of a run alone are 0.3
UNDO_STEPS = 8  # that Blender keeps; fewer than the warm-up makes, so that they are all there when it ends

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(1200),
    pytest.mark.skipif(sys.platform != "linux", reason="looks at this process in /proc"),
]


def data_blocks() -> dict[str, int]:
    """How many of each kind the file has."""
    kinds = [name for name in dir(bpy.data) if isinstance(getattr(bpy.data, name), bpy.types.bpy_prop_collection)]
    return {name: len(getattr(bpy.data, name)) for name in kinds}


def gaussians() -> list[bpy.types.Object]:
    """Those in the scene; undo makes other objects of all that Python had in its hands."""
    return [candidate for candidate in bpy.context.scene.objects if is_splats(candidate)]


@pytest.fixture
def few_undo_steps():
    edit = bpy.context.preferences.edit
    before, edit.undo_steps = edit.undo_steps, UNDO_STEPS
    yield
    edit.undo_steps = before


@pytest.mark.usefixtures("few_undo_steps")
def test_runs_that_are_loaded_undone_redone_and_removed_leave_nothing_in_blender(capture, worker, run_folder, tmp_path):
    picture = tmp_path / "picture.png"
    write_picture(picture, np.full((90, 120, 3), 128, np.uint8))
    show = f'for _ in range(3): emit("preview", file={str(picture)!r})\n'
    worker(show + textwrap.dedent(finishing(run_folder)))
    capture.cvdgs.run.start_over = True
    blocks = []

    def make_undo_redo_and_remove(_number: int) -> None:
        making.start_run(bpy.context.scene)
        bpy.ops.ed.undo_push(message="before")
        job = finished(making.JOB)
        assert job.state is State.DONE, job.problem
        bpy.ops.ed.undo_push(message="run")  # as `activity.remember_for_undo` does where there is a window
        bpy.ops.ed.undo()
        assert gaussians() == []
        bpy.ops.ed.redo()
        (splats,) = gaussians()
        assert {"original", "deutan-1.0"} <= set(layer_names(splats))
        (collection,) = splats.users_collection
        bpy.data.batch_remove([collection, *collection.all_objects])
        bpy.ops.outliner.orphans_purge(do_recursive=True)
        blocks.append(data_blocks())

    course = repeat(make_undo_redo_and_remove, ROUNDS, WARM_UP)
    print(course)
    assert blocks[-1] == blocks[WARM_UP]
    assert {(held.handles, held.threads) for held in course.rounds} == {
        (course.rounds[0].handles, course.rounds[0].threads)
    }
    assert course.growth < GROWTH
    assert ACTIVITY.running(making.JOB) is None
