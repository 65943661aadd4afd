"""The shape of the result holds in the shortest of runs, and the command that measures everything works."""

import argparse
import subprocess
import sys
from pathlib import Path

import pytest

from cvdgs.core.demo import SHOWROOM
from cvdgs.core.evaluate.studies.claims import measure_claims
from cvdgs.core.evaluate.studies.scenes import DEMO
from cvdgs.core.evaluate.studies.subject import CaptureFolder
from cvdgs.core.events import Reporter
from cvdgs.scripts.benchmarks.everything import STUDIES, options_of

ROOT = Path(__file__).resolve().parents[4]
SIZE, STEPS = 64, 60
PARTS = ("table", "severities", "pareto", "budget", "stress", "ablation", "figure", "claims")


def test_the_shape_of_the_result_holds_in_a_run_of_seconds(tmp_path):
    claims = measure_claims(CaptureFolder(DEMO, SHOWROOM, SIZE), STEPS, tmp_path, Reporter())
    assert len(claims) == 3
    assert all(claim.holds for claim in claims), claims


@pytest.mark.parametrize("part", STUDIES, ids=lambda part: part.name)
def test_the_command_for_everything_asks_each_part_in_the_same_places(part, tmp_path):
    asked = argparse.Namespace(quick=True, out=tmp_path)
    options = options_of(part, asked, tmp_path / "work")
    assert (options.out, options.work, options.quick, options.part) == (tmp_path, tmp_path / "work", True, part.name)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_everything_is_measured_by_one_command(tmp_path):
    command = [sys.executable, str(ROOT / "scripts" / "benchmark.py"), "all", "--quick", "--out", str(tmp_path)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr[-2000:]
    assert all((tmp_path / f"{part}.md").stat().st_size > 0 for part in PARTS)
    assert "**no**" not in (tmp_path / "claims.md").read_text(encoding="utf-8")
