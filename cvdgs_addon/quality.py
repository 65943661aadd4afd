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
REFERENCE_PROCESSORS = 2  # of the reference machine, an AMD EPYC without a GPU


@dataclass(frozen=True)
class TimeModel:
    """Seconds on the reference machine by stage, fitted to runs on the embedded demo at all qualities.

    Attributes:
        start: of the processes.
        read: a megapixel of photographs, at their full size.
        check: of looking whether the cameras' focal length is right.
        enhance, enhance_view: of fitting the colours of a layer, and a megapixel of views besides.
        step, step_view: of a training step, and a megapixel of its view besides.
        layer, layer_view: of fitting a layer to the geometry, and a megapixel of views besides.
        evaluate, evaluate_view: of measuring, and a megapixel of views besides.
        blender: of the scene file and stills.
    """

    start: float = 3.0
    read: float = 0.2
    check: float = 2.0
    enhance: float = 6.0
    enhance_view: float = 0.7
    step: float = 0.015
    step_view: float = 0.27
    layer: float = 6.0
    layer_view: float = 2.2
    evaluate: float = 4.0
    evaluate_view: float = 1.6
    blender: float = 34.0

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
        seconds = {
            "start": self.start,
            "capture": self.read * full * views + self.check,
            "enhance": self.enhance + self.enhance_view * view * views,
            "geometry": quality.iterations * (self.step + self.step_view * view),
            "layers": self.layer + self.layer_view * view * views,
            "evaluate": self.evaluate + self.evaluate_view * view * views,
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
        if seconds is None or stage not in reference:
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
