"""The axes of the stress test: conditions that are made worse level by level, and the perturbations that do it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ....core.capture.model import Capture
from ....core.capture.reader import warnings_of_cameras
from ....core.settings import Layer
from ..enhancers.methods import PER_VIEW_LUT
from ..studies.captures import CaptureFolder, Subject
from ..studies.recipe import Recipe
from . import perturbations

LEVELS = 5
HARMLESS = 0
"""The level without any perturbation; the same for all axes."""

# Pickled along with axes, so no lambdas.
Perturb = Callable[[Capture, float, np.random.Generator], Capture]
PerturbSubject = Callable[[Subject, float, np.random.Generator], Subject]
Vary = Callable[[Recipe, float], Recipe]


@dataclass(frozen=True)
class Axis:
    """One condition. Exactly one of `perturb`, `perturb_subject`, `vary` and `scene_option` is given.

    Attributes:
        name: on the command line and in files.
        title: in charts; says what the values are.
        levels: the values of the levels above `HARMLESS`, from mild to severe.
        unit: after a value in texts; may be empty.
        perturb: perturbs the given capture by a value; results are judged by the unperturbed one.
        perturb_subject: the same where more than the given capture changes.
        vary: changes a recipe by a value.
        scene_option: of scripts/make_showroom.py, which renders a scene with the value.
        untouched: the value at the harmless level, as text.
        factor: multiplies values in texts.
    """

    name: str
    title: str
    levels: tuple[float, float, float, float]
    unit: str = ""
    perturb: Perturb | None = None
    perturb_subject: PerturbSubject | None = None
    vary: Vary | None = None
    scene_option: str = ""
    untouched: str = "0"
    factor: float = 1.0

    def value(self, level: int) -> float:
        """The value of a level above `HARMLESS`."""
        return self.levels[level - 1]

    def text(self, level: int) -> str:
        """The value of a level as charts and tables show it."""
        if level == HARMLESS:
            return self.untouched
        value = self.value(level)
        return "a LUT each" if math.isinf(value) else f"{self.factor * value:g}{self.unit}"

    def apply(self, subject: Subject, level: int, seed: int) -> Subject:
        """The subject at a level; the generator of perturbations depends only on axis and seed."""
        rng = np.random.default_rng([seed, *self.name.encode()])
        if level != HARMLESS and self.perturb is not None:
            return replace(subject, given=self.perturb(subject.given, self.value(level), rng))
        if level != HARMLESS and self.perturb_subject is not None:
            return self.perturb_subject(subject, self.value(level), rng)
        return subject

    def recipe(self, recipe: Recipe, level: int) -> Recipe:
        """The recipe at a level."""
        return recipe if level == HARMLESS or self.vary is None else self.vary(recipe, self.value(level))


@dataclass(frozen=True)
class PerturbedCapture:
    """A subject whose given capture is perturbed; results are judged by the unperturbed one.

    Attributes:
        base: the capture.
        axis, level: the perturbation.
        seed: of its directions.
    """

    base: CaptureFolder
    axis: Axis
    level: int
    seed: int

    @property
    def name(self) -> str:
        return f"{self.base.name}-{self.axis.name}-{self.level}"

    @property
    def key(self) -> str:
        value = None if self.level == HARMLESS else self.axis.value(self.level)
        return repr((self.base.key, self.axis.name, value, self.seed))

    def load(self) -> Subject:
        return self.axis.apply(self.base.load(), self.level, self.seed)


def _views(subject: Subject, count: float, rng: np.random.Generator) -> Subject:
    """That many photographs, none of them among those that results are judged by; every eighth is held out as usual."""
    given = _warned(perturbations.fewer_views(subject.given, subject.split.train, int(count), rng))
    return replace(subject, given=given, split=Subject.of(given).split)


def _points(capture: Capture, share: float, rng: np.random.Generator) -> Capture:
    return _warned(perturbations.fewer_points(capture, share, rng))


def _warned(capture: Capture) -> Capture:
    """With the warnings that reading such a capture gives."""
    more = warnings_of_cameras(capture.source, len(capture.views), len(capture.points))
    return replace(capture, warnings=(*capture.warnings, *more))


def _saturation(subject: Subject, factor: float, rng: np.random.Generator) -> Subject:
    """The scene itself changes, so it is judged by its own colours."""
    vivid = perturbations.saturated(subject.judged, factor)
    return Subject(vivid, subject.judged_split, vivid, subject.judged_split)


def _drift(recipe: Recipe, degrees: float) -> Recipe:
    """Infinite: a LUT fitted to every image anew, which is inconsistent of itself."""
    if math.isinf(degrees):
        return replace(recipe, enhancer=PER_VIEW_LUT)
    return replace(recipe, drift=degrees)


def _severity(recipe: Recipe, severity: float) -> Recipe:
    return replace(recipe, layer=Layer(recipe.layer.cvd, severity))


AXES = (
    Axis("views", "photographs", (20, 10, 6, 3), perturb_subject=_views, untouched="40"),
    Axis(
        "poses", "cameras turned by", (0.25, 0.5, 1.0, 2.0), "°", perturb=perturbations.turned_cameras, untouched="0°"
    ),
    Axis(
        "intrinsics",
        "focal length too long by",
        (0.02, 0.05, 0.1, 0.2),
        " %",
        perturbations.wrong_focal_length,
        untouched="0 %",
        factor=100,
    ),
    Axis(
        "exposure",
        "exposure and white balance vary by",
        (0.15, 0.3, 0.6, 1.2),
        " stops",
        perturbations.jittered_exposure,
        untouched="0 stops",
    ),
    Axis("points", "sparse points", (0.1, 0.03, 0.01, 0.0), " %", _points, untouched="100 %", factor=100),
    Axis(
        "blur",
        "motion blur, of the width",
        (0.01, 0.02, 0.04, 0.08),
        " %",
        perturbations.motion_blurred,
        untouched="0 %",
        factor=100,
    ),
    Axis("jpeg", "JPEG quality", (30, 15, 8, 3), perturb=perturbations.compressed, untouched="91"),
    Axis("light", "light lost", (3, 5, 7, 9), " stops", perturbations.dimly_lit, untouched="0 stops"),
    Axis("saturation", "chroma times", (1.5, 2.0, 3.0, 5.0), perturb_subject=_saturation, untouched="1"),
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
