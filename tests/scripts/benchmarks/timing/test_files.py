"""Every format is written and read, models are read, and a real Blender imports."""

from __future__ import annotations

import importlib.util
import re

import pytest

from cvdgs.core.capture.colmap_files import read_model
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.scripts.benchmarks.timing.files import time_files, write_file_times, write_model

HAS_BLENDER = importlib.util.find_spec("bpy") is not None


def test_files_are_timed_in_all_rounds_and_in_blender_where_there_is_one(tmp_path):
    found = time_files(200, 50, 2, Reporter())
    text = write_file_times(tmp_path, 200, 50, found)
    files = re.findall(r"^\| (\.\w+|COLMAP, \w+|Blender) \|", text, re.MULTILINE)
    models = ["COLMAP, binary", "COLMAP, text"]
    assert files == [".ply", ".spz", ".splat", ".glb", *models, *(["Blender"] if HAS_BLENDER else [])]
    assert {timing.round for timing in found} == {1, 2}
    assert all(timing.seconds > 0.0 for timing in found)
    assert (tmp_path / "files.csv").read_text().count("\n") == len(found) + 1


@pytest.mark.parametrize("text", [False, True], ids=["binary", "text"])
def test_the_model_that_is_read_has_all_its_points(tmp_path, text):
    write_model(tmp_path / "model", 40, text=text)
    model = read_model(tmp_path / "model")
    assert len(model.points) == len(model.point_colors) == 40
    assert [image.name for image in model.images] == ["1.png", "2.png", "3.png"]
