"""How fine a run becomes, and how long it takes on this machine. No bpy.

The times are a model that was fitted to runs on a reference machine; a machine's speed relative to that one is measured
when its worker is checked, and every run that it finishes or is cancelled corrects that stage by stage.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass

from ..core.settings import QUALITIES, Quality

_LEAST_SECONDS = 0.05  # of a stage
_TELLING_SECONDS = 0.5  # of a stage; shorter ones say nothing of how long they take elsewhere
REFERENCE_PROCESSORS = 2  # of the reference machine, an AMD EPYC without a GPU


@dataclass(frozen=True)
class TimeModel:
    """Seconds on the reference machine by stage, fitted to short runs on 20 and 40 small views and to the demo's.

    "A view" is a megapixel of one, at the size that is trained on; "views" are how many there are.

    Attributes:
        start: of the processes.
        open, read: of looking at the capture, and a megapixel of photographs, at their full size, besides.
        check, check_view: of looking whether the cameras' focal length is right, and a view besides.
        enhance, enhance_views, enhance_pixels: of fitting the colours of a layer, and each of the views and a megapixel
            of all of them besides.
        train_views: of training, each of the views, whatever the steps.
        step_view: of a training step, a view.
        layer, layer_view: of fitting a layer to the geometry, and a view besides.
        evaluate, evaluate_views, evaluate_pixels: of measuring, and each of the views and a megapixel of all besides.
        blender: of the scene file and stills.
    """

    start: float = 3.8
    open: float = 0.25
    read: float = 0.2
    check: float = 2.55
    check_view: float = 88.0
    enhance: float = 5.1
    enhance_views: float = 0.086
    enhance_pixels: float = 1.36
    train_views: float = 0.075
    step_view: float = 0.34
    layer: float = 0.5
    layer_view: float = 75.0
    evaluate: float = 0.4
    evaluate_views: float = 0.028
    evaluate_pixels: float = 1.75
    blender: float = 24.0

    def stages(
        self, quality: Quality, views: int, width: int, height: int, *, adds_layer: bool, scene_file: bool = False
    ) -> dict[str, float]:
        """Of a run on `views` photographs of `width` × `height` pixels.

        Args:
            adds_layer: to a finished run, whose size of views is not known here and taken to be the quality's.
            scene_file: whether Blender writes a scene file and stills.
        """
        scale = min(1.0, quality.max_size / max(width, height, 1))
        full = width * height / 1e6
        view = full * scale * scale
        pixels = view * views
        check = 0.0 if adds_layer else self.check + self.check_view * view
        seconds = {
            "start": self.start,
            "capture": self.open + self.read * full * views + check,
            "enhance": self.enhance + self.enhance_views * views + self.enhance_pixels * pixels,
            "geometry": self.train_views * views + quality.iterations * self.step_view * view,
            "layers": self.layer + self.layer_view * view,
            "evaluate": self.evaluate + self.evaluate_views * views + self.evaluate_pixels * pixels,
            "blender": self.blender,
        }
        left_out = {"geometry": adds_layer, "blender": not scene_file}
        return {stage: value for stage, value in seconds.items() if not left_out.get(stage)}


TIME_MODEL = TimeModel()


def quality_called(name: str) -> Quality:
    """The quality of that name."""
    return next(quality for quality in QUALITIES if quality.name == name)


def likely_speed() -> float:
    """This machine's speed relative to the reference one as long as nothing was measured: by its processors alone.

    A step is in part serial, so that twice the processors are not twice as fast.
    """
    return math.sqrt((os.cpu_count() or REFERENCE_PROCESSORS) / REFERENCE_PROCESSORS)


def expected_seconds(reference: Mapping[str, float], speed: float, learned: Mapping[str, float]) -> dict[str, float]:
    """Seconds by stage on this machine.

    Args:
        reference: seconds of the stages on the reference machine.
        speed: relative to that, of stages that no run has timed yet.
        learned: speeds of those that one has.
    """
    return {stage: seconds / learned.get(stage, speed) for stage, seconds in reference.items()}


def learned_speeds(
    before: Mapping[str, float], reference: Mapping[str, float], taken: Mapping[str, float | None]
) -> dict[str, float]:
    """The speeds of the stages after a run: what the first one showed, then a mean in which later ones weigh most.

    Args:
        before: what was learned so far.
        reference: seconds of the stages on the reference machine.
        taken: seconds of those that were timed.
    """
    speeds = dict(before)
    for stage, seconds in taken.items():
        if seconds is None or stage not in reference or max(seconds, reference[stage]) < _TELLING_SECONDS:
            continue
        now = reference[stage] / max(seconds, _LEAST_SECONDS)
        speeds[stage] = math.sqrt(before[stage] * now) if before.get(stage, 0.0) > 0.0 else now
    return speeds


def in_words(seconds: float) -> str:
    """A rough time, as rough as an estimate is: "about 40 s", "about 5 min", "about 1.5 h"."""
    if seconds < 55.0:
        return f"about {max(round(seconds / 10.0), 1) * 10} s"
    if seconds < 5400.0:
        return f"about {max(round(seconds / 60.0), 1)} min"
    return f"about {seconds / 3600.0:.1f} h"
