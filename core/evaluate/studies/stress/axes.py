"""The axes of stress: what is made worse, in which levels, and what that changes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ....capture.reader import warnings_of_cameras
from ....settings import Layer
from ..enhancers import PER_VIEW_LUT
from ..recipe import Recipe
from ..subject import Subject
from . import disturbances

LEVELS = 5
HARMLESS = 0
"""The level at which a capture is left as it is; the same for all axes."""

Disturb = Callable[[Subject, float, np.random.Generator], Subject]
Vary = Callable[[Recipe, float], Recipe]


@dataclass(frozen=True)
class Axis:
    """One condition. Exactly one of `disturb`, `vary` and `scene_option` is given.

    Attributes:
        name: for the command line and files.
        title: for charts, with what the values are.
        levels: the values of the levels that are not harmless, ever worse.
        unit: behind a value in texts; may be empty.
        disturb: makes a capture so, given a value.
        vary: makes a recipe so.
        scene_option: of scripts/make_showroom.py, which renders a scene that is so.
        untouched: the value that a capture has at the harmless level, as a text.
        factor: what values are multiplied by in texts.
    """

    name: str
    title: str
    levels: tuple[float, float, float, float]
    unit: str = ""
    disturb: Disturb | None = None
    vary: Vary | None = None
    scene_option: str = ""
    untouched: str = "0"
    factor: float = 1.0

    def value(self, level: int) -> float:
        """The value of a level above `HARMLESS`."""
        return self.levels[level - 1]

    def text(self, level: int) -> str:
        """The value of a level as charts and tables say it."""
        if level == HARMLESS:
            return self.untouched
        value = self.value(level)
        return "a LUT each" if math.isinf(value) else f"{self.factor * value:g}{self.unit}"

    def apply(self, subject: Subject, level: int, seed: int) -> Subject:
        """The subject at a level; `disturb` draws from a generator that only axis and seed decide."""
        if level == HARMLESS or self.disturb is None:
            return subject
        return self.disturb(subject, self.value(level), np.random.default_rng([seed, *self.name.encode()]))

    def recipe(self, recipe: Recipe, level: int) -> Recipe:
        """The recipe at a level."""
        return recipe if level == HARMLESS or self.vary is None else self.vary(recipe, self.value(level))


def _views(subject: Subject, count: float, rng: np.random.Generator) -> Subject:
    """So many photographs, none of those that the result is judged by; every eighth is held out as always."""
    given = disturbances.fewer_views(subject.given, subject.split.train, int(count), rng)
    warnings = (*given.warnings, *warnings_of_cameras(given.source, len(given.views), len(given.points)))
    given = replace(given, warnings=warnings)
    return replace(subject, given=given, split=Subject.of(given).split)


def _points(subject: Subject, share: float, rng: np.random.Generator) -> Subject:
    given = disturbances.fewer_points(subject.given, share, rng)
    warnings = (*given.warnings, *warnings_of_cameras(given.source, len(given.views), len(given.points)))
    return replace(subject, given=replace(given, warnings=warnings))


def _poses(subject: Subject, degrees: float, rng: np.random.Generator) -> Subject:
    return replace(subject, given=disturbances.turned_cameras(subject.given, degrees, rng))


def _intrinsics(subject: Subject, share: float, rng: np.random.Generator) -> Subject:
    return replace(subject, given=disturbances.wrong_focal_length(subject.given, share))


def _exposure(subject: Subject, stops: float, rng: np.random.Generator) -> Subject:
    return replace(subject, given=disturbances.jittered_exposure(subject.given, stops, rng))


def _blur(subject: Subject, share: float, rng: np.random.Generator) -> Subject:
    return replace(subject, given=disturbances.motion_blurred(subject.given, share, rng))


def _jpeg(subject: Subject, quality: float, rng: np.random.Generator) -> Subject:
    return replace(subject, given=disturbances.compressed(subject.given, int(quality)))


def _light(subject: Subject, stops: float, rng: np.random.Generator) -> Subject:
    return replace(subject, given=disturbances.dimly_lit(subject.given, stops, rng))


def _saturation(subject: Subject, factor: float, rng: np.random.Generator) -> Subject:
    """The scene itself is so: it is judged by its own colours."""
    vivid = disturbances.saturated(subject.judged, factor)
    return Subject(vivid, subject.judged_split, vivid, subject.judged_split)


def _drift(recipe: Recipe, degrees: float) -> Recipe:
    """Infinite: a LUT that is fitted to every image anew, which contradicts itself by its own means."""
    if math.isinf(degrees):
        return replace(recipe, enhancer=PER_VIEW_LUT)
    return replace(recipe, drift=degrees)


def _severity(recipe: Recipe, severity: float) -> Recipe:
    return replace(recipe, layer=Layer(recipe.layer.cvd, severity))


AXES = (
    Axis("views", "photographs", (20, 10, 6, 3), disturb=_views, untouched="40"),
    Axis("poses", "cameras turned by", (0.25, 0.5, 1.0, 2.0), "°", disturb=_poses, untouched="0°"),
    Axis(
        "intrinsics", "focal length too long by", (0.02, 0.05, 0.1, 0.2), " %", _intrinsics, untouched="0 %", factor=100
    ),
    Axis(
        "exposure",
        "exposure and white balance vary by",
        (0.15, 0.3, 0.6, 1.2),
        " stops",
        _exposure,
        untouched="0 stops",
    ),
    Axis("points", "sparse points", (0.1, 0.03, 0.01, 0.0), " %", _points, untouched="100 %", factor=100),
    Axis("blur", "motion blur, of the width", (0.01, 0.02, 0.04, 0.08), " %", _blur, untouched="0 %", factor=100),
    Axis("jpeg", "JPEG quality", (30, 15, 8, 3), disturb=_jpeg, untouched="91"),
    Axis("light", "light lost", (3, 5, 7, 9), " stops", _light, untouched="0 stops"),
    Axis("saturation", "chroma times", (1.5, 2.0, 3.0, 5.0), disturb=_saturation, untouched="1"),
    Axis(
        "satin", "roughness of the satin", (0.25, 0.15, 0.08, 0.0), scene_option="--satin-roughness", untouched="0.36"
    ),
    Axis(
        "sheer", "opacity of the sheer cloth", (0.3, 0.2, 0.1, 0.04), scene_option="--sheer-opacity", untouched="0.42"
    ),
    Axis("yarn", "width of the yarns times", (0.6, 0.35, 0.2, 0.1), scene_option="--yarn-scale", untouched="1"),
    Axis("drift", "hue drifts from image to image by", (5.0, 15.0, 45.0, math.inf), "°", vary=_drift, untouched="0°"),
    Axis("severity", "severity", (0.75, 0.5, 0.25, 0.0), vary=_severity, untouched="1"),
)
"""In the order in which a user meets them: the capture, the scene, the enhancement."""
