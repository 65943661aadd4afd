"""A batch with the real worker and the real Blender: from photographs to the page, and a layer for a finished run."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.files.images import read_png

from ...few_views import write_few_views

SMALL = """
[train]
iterations = 20
max_size = 64
holdout = 0
device = "cpu"
[turntable]
frames = 2
chunk = 1
size = [64, 48]
"""


def run(batch: str, folder: Path, out: str) -> dict:
    """The result of scripts/turntable.py, which succeeds."""
    (folder / "batch.toml").write_text(batch)
    command = [sys.executable, str(ROOT / "scripts" / "turntable.py"), str(folder / "batch.toml"), "--json"]
    ended = subprocess.run([*command, "--out", str(folder / out)], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return json.loads(ended.stdout.splitlines()[-1])


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_from_photographs_to_the_page_and_a_layer_for_a_finished_run(tmp_path):
    pytest.importorskip("bpy")
    capture = write_few_views(tmp_path / "showroom", 10)
    batch = f"{SMALL}\n[[items]]\ncapture = '{capture}'\nlayers = ['original', 'deutan']\n"
    result = run(batch, tmp_path, "first")
    assert result["items"] == {"showroom": True}
    turn = tmp_path / "first/showroom/deutan-1.0/cycles-turn"
    enhanced, simulated = (read_png(turn / name / "0001.png") for name in ("frames", "simulated-deutan-1.0"))
    assert enhanced.shape == simulated.shape == (48, 64, 3)
    assert (turn / "turntable.mp4").stat().st_size > 0
    assert (turn / "side-by-side-deutan-1.0.mp4").stat().st_size > 0
    assert (tmp_path / "first/showroom/contact-sheet.png").stat().st_size > 0
    assert "showroom" in Path(result["page"]).read_text()

    again = run(batch, tmp_path, "first")
    assert again["tasks"]["done"] == 0

    finished = tmp_path / "first/showroom/run"
    added = f"outputs = ['frames']\n{SMALL}\n[[items]]\nname = 'more'\nrun = '{finished}'\nlayers = ['protan-0.6']\n"
    result = run(added, tmp_path, "second")
    assert result["items"] == {"more": True}
    report = json.loads((tmp_path / "second/more/run/report.json").read_text())
    assert sorted(report["layers"]) == ["deutan-1.0", "protan-0.6"]
    assert sorted(json.loads((finished / "report.json").read_text())["layers"]) == ["deutan-1.0"]
