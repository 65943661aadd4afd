"""The job that looks at a capture for the panel: a summary, and small pictures of the first photographs."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.capture.reader import write_thumbnails
from cvdgs.core.demo import SHOWROOM
from cvdgs.core.errors import InputError
from cvdgs.core.files.images import read_png


def inspect(**request: object) -> tuple[int, list[dict]]:
    """Exit code and events of the worker's job."""
    result = subprocess.run(
        [sys.executable, ROOT / "core" / "__main__.py"],
        input=json.dumps({"job": "inspect", **request}) + "\n",
        capture_output=True,
        text=True,
        timeout=120,
    )
    return result.returncode, [json.loads(line) for line in result.stdout.splitlines()]


def test_thumbnails_keep_the_aspect_and_the_colours(tmp_path):
    paths = write_thumbnails(SHOWROOM, tmp_path / "small", count=3, size=64)
    assert [path.name for path in paths] == ["0.png", "1.png", "2.png"]
    pictures = [read_png(path) for path in paths]
    assert {picture.shape for picture in pictures} == {(48, 64, 3)}
    assert all(20 < picture.mean() < 235 for picture in pictures)
    assert abs(pictures[0].astype(int) - pictures[1]).mean() > 1.0


def test_photographs_without_cameras_have_thumbnails_unless_given_ones_are_wanted(tmp_path):
    with pytest.raises(InputError, match="no cameras"):
        write_thumbnails(SHOWROOM / "images", tmp_path, count=1, size=64, cameras="given")
    assert len(write_thumbnails(SHOWROOM / "images", tmp_path, count=1, size=64)) == 1


def test_the_worker_summarises_a_capture_and_shows_it(tmp_path):
    pictures = {"folder": str(tmp_path), "count": 2, "size": 64}
    code, events = inspect(capture=str(SHOWROOM), thumbnails=pictures)
    assert code == 0
    summary = events[-1]["summary"]
    assert (summary["format"], summary["views"], summary["sizes"]) == ("transforms", 40, [[480, 360, 40]])
    assert [Path(path).name for path in events[-1]["thumbnails"]] == ["0.png", "1.png"]


def test_the_worker_says_in_one_line_why_a_folder_cannot_be_used(tmp_path):
    code, events = inspect(capture=str(tmp_path))
    assert code == 2
    assert [event["event"] for event in events] == ["error"]
    assert "no photographs and no cameras found" in events[0]["message"]
