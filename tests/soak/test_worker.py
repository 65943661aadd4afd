"""Fifty jobs in one process through the worker's own functions: whole runs, and looks at a capture."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from cvdgs.core.capture.reader import write_thumbnails
from cvdgs.core.pipeline.run import run
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.settings import Layer, Settings

from ..few_views import write_few_views
from .measure import repeat

ROUNDS, WARM_UP = 50, 5
GROWTH = 0.5  # MiB a run
VIEWS = 6

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(3600),
    pytest.mark.skipif(sys.platform != "linux", reason="looks at this process in /proc"),
]


@pytest.fixture
def capture(tmp_path) -> Path:
    """A few of the demo's views."""
    return write_few_views(tmp_path / "photographs", VIEWS)


def test_runs_leave_nothing_in_the_process(capture, tmp_path):
    out = tmp_path / "out"

    def do_jobs(number: int) -> None:
        write_thumbnails(capture, out / "thumbnails", count=4, size=64)
        settings = Settings(
            str(capture),
            str(out),
            (Layer("deutan", 1.0),),
            mode=("layers", "joint", "post")[number % 3],
            enhancer="cgan" if number % 10 == 0 else "none",  # whose fit takes most of the time
            iterations=30,
            gaussians=500,
            max_size=48,
        )
        run(settings, out, Reporter(), previews=True)
        shutil.rmtree(out)

    course = repeat(do_jobs, ROUNDS, WARM_UP)
    print(course)
    assert {(held.handles, held.threads) for held in course.rounds} == {
        (course.rounds[0].handles, course.rounds[0].threads)
    }
    assert course.growth < GROWTH
