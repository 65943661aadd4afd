"""Pictures of a run while it goes on."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from cvdgs.core.demo import SHOWROOM
from cvdgs.core.files.images import read_png
from cvdgs.core.pipeline.launch import run
from cvdgs.core.pipeline.preview import PreviewedTraining
from cvdgs.core.runtime.process import Event, Workers
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.settings import Settings


def test_a_run_shows_how_far_it_is_and_leaves_no_picture(tmp_path):
    out, pictures, stages = tmp_path / "out", [], []
    reached: dict[str, list[float]] = {}

    def listen(event: Event) -> None:
        if event["event"] == "preview" and Path(event["file"]).is_file():
            pictures.append(read_png(Path(event["file"])))
        if event["event"] == "progress":
            reached.setdefault(event["stage"], []).append(event["fraction"])
        stages.append({"preview": "picture", "forecast": "forecast"}.get(event["event"], event.get("stage")))

    settings = Settings(str(SHOWROOM), str(out), iterations=60, gaussians=2000, max_size=96, blend=False)
    run(settings, listen, Workers(sys.executable), previews=True)
    assert len(pictures) >= 2
    assert stages.index("picture") < stages.index("enhance")  # the sparse points, before anything is fitted
    assert pictures[0].max() > 64
    assert {picture.shape for picture in pictures} == {(72, 96, 3)}
    assert np.abs(pictures[0].astype(int) - pictures[-1]).mean() > 1.0
    assert stages.index("forecast") < stages.index("enhance")
    for stage in ("geometry", "layers"):
        assert reached[stage] == sorted(reached[stage])
        assert reached[stage][-1] == 1.0
    assert not [path.name for path in out.rglob("*") if "preview" in path.name]


def test_a_training_is_not_held_up_by_its_pictures():
    shown, heard = [], []

    class Picture:
        def show(self, gaussians: object) -> None:
            shown.append(gaussians)

    class Ears(Reporter):
        def progress(self, stage: str, fraction: float, message: str = "") -> None:
            heard.append(fraction)

    training = PreviewedTraining(Ears(), Picture())
    training.progress("geometry", 0.0)
    assert not shown  # there is no scene yet
    training.scene(lambda: "gaussians")
    for step in range(1, 50):
        training.progress("geometry", step / 50)
    assert len(heard) == 50
    assert shown == ["gaussians"]
