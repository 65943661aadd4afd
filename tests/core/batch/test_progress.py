"""How far a batch is, as its tasks tell."""

from __future__ import annotations

from pathlib import Path

import pytest

from cvdgs.core.batch.progress import BatchProgress
from cvdgs.core.batch.task import Kind, Plan, Task
from cvdgs.core.pipeline.launch import stages_of
from cvdgs.core.settings import Settings


@pytest.mark.parametrize(("kind", "adds_layer"), [(Kind.TRAIN, False), (Kind.LAYER, True)])
def test_a_run_in_a_batch_gets_through_its_own_stages_in_their_order(kind, adds_layer):
    task = Task("vase.run", kind, seconds=60.0)
    progress = BatchProgress(Plan(Path("out"), (task,)), None, {})
    progress.start(task)
    fractions = []
    for stage in stages_of(Settings("photos", "out", blend=False, resume=adds_layer)):
        for fraction in (0.0, 0.5, 1.0):
            progress.update(task, {"event": "progress", "stage": stage, "fraction": fraction})
            fractions.append(progress.fraction)
    assert fractions == sorted(fractions)
    assert len(set(fractions)) > len(fractions) // 2
    assert fractions[-1] == pytest.approx(1.0)
