"""A run on photographs that are known to be smeared, and what it says of that."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cvdgs.core.pipeline.run import run
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.settings import Settings

from ...few_views import write_few_views


def notes_of(capture: Path, out: Path) -> dict[str, str]:
    out.mkdir()
    settings = Settings(capture=str(capture), out=str(out), iterations=20, gaussians=800, enhancer="none", device="cpu")
    return run(settings, out, Reporter())["notes"]


@pytest.mark.parametrize("smeared", [False, True])
def test_the_report_says_where_renderings_were_smeared_before_they_were_compared(smeared: bool, tmp_path: Path) -> None:
    write_few_views(tmp_path / "capture", 9, 0.2)
    file = tmp_path / "capture" / "transforms.json"
    cameras = json.loads(file.read_text())
    if smeared:
        for frame in cameras["frames"]:
            frame["motion_blur"] = [3.0, 1.0]
        file.write_text(json.dumps(cameras))
    assert ("motion blur" in notes_of(tmp_path / "capture", tmp_path / "out")) == smeared
