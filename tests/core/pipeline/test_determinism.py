"""The same photographs, settings and seed give the same files on the CPU, whatever the number of threads."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from cvdgs.core.pipeline.device import versions
from cvdgs.core.runtime.process import ROOT

from ...few_views import write_few_views

VIEWS = 6
RUN = """
import os, sys
threads, capture, out, mode, enhancer = sys.argv[1:]
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: int(threads)])

from pathlib import Path
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.pipeline.run import run
from cvdgs.core.settings import Layer, Settings
from cvdgs.core.runtime.resources import available_processors

assert available_processors() == int(threads)
plan = {"iterations": 60, "max_size": 48, "gaussians": 6000}
settings = Settings(capture, out, (Layer("deutan", 1.0),), mode=mode, enhancer=enhancer, **plan)
report = run(settings, Path(out), Reporter())
assert report["gaussians"] > 4096, report["gaussians"]  # as many as all stages of a step share out between threads
"""


@pytest.fixture
def capture(tmp_path) -> Path:
    """A few of the demo's views."""
    return write_few_views(tmp_path / "photographs", VIEWS)


def digests(folder: Path) -> dict[str, str]:
    files = [
        *folder.glob("*.ply"),
        *folder.glob("*.cube"),
        *folder.glob("enhanced/*/*.png"),
        *folder.rglob("renders/**/*.png"),
    ]
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.mark.timeout(1200)  # two fresh processes on a busy machine
@pytest.mark.skipif(
    not hasattr(os, "sched_setaffinity") or len(os.sched_getaffinity(0)) < 2,
    reason="needs two processors to choose from",
)
@pytest.mark.parametrize(
    ("mode", "enhancer"),
    [
        ("layers", "lut"),
        pytest.param("layers", "cgan", marks=pytest.mark.slow),
        pytest.param("joint", "lut", marks=pytest.mark.slow),
        pytest.param("joint", "cgan", marks=pytest.mark.slow),
    ],
)
def test_one_thread_and_two_give_the_same_bytes(mode, enhancer, capture, tmp_path):
    found = []
    for threads in ("1", "2"):
        out = tmp_path / threads
        out.mkdir()
        subprocess.run([sys.executable, "-c", RUN, threads, str(capture), str(out), mode, enhancer], check=True)
        found.append(digests(out))
    assert {"splats.ply", "splats.deutan-1.0.ply"} <= found[0].keys()
    assert found[0] == found[1]


def test_a_report_names_the_version_of_everything_that_the_worker_requires():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    required = {re.match(r"[\w-]+", requirement)[0] for requirement in project["dependencies"]}
    assert required | {"cvdgs", "python"} == versions().keys()
    assert "none" not in versions().values()
