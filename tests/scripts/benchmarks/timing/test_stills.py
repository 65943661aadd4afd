"""The seconds of a still, by a real Blender on a small scene."""

from __future__ import annotations

import re

import pytest

pytest.importorskip("bpy", reason="there is no Blender to render with")
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.scripts.benchmarks.timing.stills import StillTimes

from ....addon.scenes import synthetic_run


def test_stills_are_timed_in_all_ways(tmp_path):
    run = synthetic_run(tmp_path / "run", 100)
    before = sorted(run.rglob("*"))
    text = StillTimes(run, "view0", gaussians=50, width=24, height=18, rounds=1).measure(Reporter())
    ways = re.findall(r"^\| (\w+) \| (\w+) \| [\d.]+ \| [\d.]+ \|$", text, re.MULTILINE)
    assert ways == [("own", "instances"), ("own", "mesh"), ("camera", "instances"), ("camera", "mesh")]
    assert len(re.findall(r"the mesh takes \d+\.\d\d of", text)) == 2
    assert sorted(run.rglob("*")) == before


def test_a_view_that_the_run_does_not_have_is_refused(tmp_path):
    with pytest.raises(InputError, match="nowhere"):
        StillTimes(synthetic_run(tmp_path / "run", 10), "nowhere").measure(Reporter())
