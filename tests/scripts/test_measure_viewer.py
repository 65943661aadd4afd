"""What a viewer is measured against: renderings that are there, for types that the run's simulation describes."""

from __future__ import annotations

from pathlib import Path

import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.runs.layout import RENDERS_FOLDER

pytest.importorskip("playwright")
from cvdgs.scripts.measure_viewer import described_by, rendered_cameras

SCENE = {"cameras": [{"name": "a"}, {"name": "b"}], "layers": ["original", "deutan-1.0"]}


def test_only_types_that_the_simulation_describes_are_measured() -> None:
    assert described_by("vienot") == ["protan", "deutan", "achromat"]
    assert described_by("machado") == ["protan", "deutan", "tritan", "achromat"]


def test_a_camera_needs_a_rendering_of_every_layer_and_a_run_needs_such_a_camera(tmp_path: Path) -> None:
    for layer, name in (("original", "a"), ("original", "b"), ("deutan-1.0", "b")):
        place = tmp_path / RENDERS_FOLDER / layer / f"{name}.png"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.touch()
    assert rendered_cameras(tmp_path, SCENE) == [{"name": "b"}]
    with pytest.raises(InputError, match="no renderings of the page's cameras"):
        rendered_cameras(tmp_path / "elsewhere", SCENE)
