"""The claims that have to hold, on figures that confirm them or not; and the command that measures everything."""

import argparse
import math
import subprocess
import sys

import pytest

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.demo import SHOWROOM
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.scripts.benchmarks import everything
from cvdgs.scripts.benchmarks.everything import STUDIES, claims_of, measure_claims, options_of, write_claims
from cvdgs.scripts.benchmarks.provenance import is_honest
from cvdgs.scripts.benchmarks.stale import facts_of_parts
from cvdgs.scripts.benchmarks.studies.captures import DEMO, CaptureFolder
from cvdgs.scripts.benchmarks.studies.recipe import Recipe, Trial, described

SIZE, STEPS = 64, 60
PARTS = ("table", "severities", "pareto", "budget", "stress", "ablation", "figure", "cost", "claims")


def trial(**figures) -> Trial:
    return Trial(**described("room", Recipe("any")), **figures)


def claims(*, layers=0.8, post=1.5, auto=2000, fixed=3000, change=0.0):
    return claims_of(trial(rwe=layers, gaussians=auto), trial(rwe=post), trial(gaussians=fixed), trial(delta_e=change))


def test_good_figures_confirm_all_claims():
    assert all(claim.holds for claim in claims())


def test_each_claim_can_fail():
    for worse in ({"layers": 1.5}, {"auto": 3001}, {"change": 0.01}):
        assert sum(not claim.holds for claim in claims(**worse)) == 1


def test_what_could_not_be_measured_does_not_hold():
    assert sum(not claim.holds for claim in claims(layers=math.nan)) == 1


def test_the_page_marks_what_does_not_hold(tmp_path):
    text = write_claims(tmp_path, claims(auto=4000))
    (broken,) = (line for line in text.splitlines() if "**no**" in line)
    assert "auto takes no more Gaussians" in broken
    assert (tmp_path / "claims.csv").is_file()


@pytest.mark.slow
def test_the_shape_of_the_result_holds_in_a_run_of_seconds(tmp_path):
    claims = measure_claims(CaptureFolder(DEMO, SHOWROOM, SIZE), STEPS, tmp_path, Reporter())
    assert len(claims) == 3
    assert all(claim.holds for claim in claims), claims


def test_claims_that_do_not_hold_are_written_with_where_they_come_from(monkeypatch, tmp_path):
    monkeypatch.setattr(everything, "STUDIES", ())
    monkeypatch.setattr(everything, "measure_claims", lambda *_: claims(auto=4000))
    options = argparse.Namespace(part="all", out=tmp_path, work=None, quick=True)
    with pytest.raises(SystemExit, match="does not hold"):
        everything.PART.run(options, "python scripts/benchmark.py all --out DIR")
    assert is_honest(tmp_path / "claims.md", facts_of_parts())


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
