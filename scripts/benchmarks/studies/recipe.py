"""Recipes: the ways to make an enhanced scene that studies compare; and trials, the figures that recipes gave."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import pandas as pd

from ....core.enhance import Enhancer
from ....core.pipeline.stages import Plans
from ....core.settings import Layer, Settings
from ....core.splats.raster import ContrastPlan
from ....core.splats.training.layers import LayerPlan
from ....core.splats.training.plan import TrainingPlan
from ....core.splats.training.start import StartRule
from ..baselines import Drifting, MatchedGain
from ..enhancers.methods import GAIN, SCENE, method_factory, method_label
from ..strategies import CloneSplitPrune

NOT_MEASURED = float("nan")
DEUTAN = Layer("deutan", 1.0)
_PLAIN_SSIM_WEIGHT = 0.2  # Kerbl et al. 2023, section 5.1
PLAIN = Plans(
    lens=None,
    training=TrainingPlan(
        ssim_weight=_PLAIN_SSIM_WEIGHT,
        coarse=(),
        start=StartRule(dense=None),
        rough=None,
        strategy=CloneSplitPrune(),
        stopping=None,
        exposure=None,
        poses=None,
        contrast=None,
    ),
    layer=LayerPlan(ssim_weight=_PLAIN_SSIM_WEIGHT, multi_view_weight=0.0, contrast=ContrastPlan(weight=0.0)),
    original=None,
    guided=False,
)
"""Plain Gaussian splatting: from sparse points, clone and split by gradients, the photometric loss of Kerbl et al. 2023
on whole photographs from the first step on; no corrections of photographs or cameras, no L_mv, no hinge on contrast.
Learning rates are the product's, whose runs are shorter than theirs."""


@dataclass(frozen=True)
class Recipe:
    """One way to make an enhanced scene. The defaults are the product's, except for the length of the run.

    Attributes:
        label: its name in tables.
        mode: see `core.settings.MODES`.
        enhancer: a name of `methods`, a weight file, or "gain", matched to the scene network.
        layer: the observer.
        simulation: model of the CVD simulation.
        iterations, gaussians, sh_degree: of the geometry, as in `Settings`.
        seed: of everything random, but for the drift.
        drift: standard deviation in degrees of a rotation of hue that differs from image to image: a known amount of
            inconsistency between views.
        plans: of the fits.
        advised: whether the product's warnings are collected; takes a second evaluation unless the subject is ordinary.
    """

    label: str
    mode: str = "layers"
    enhancer: str = SCENE
    layer: Layer = DEUTAN
    simulation: str = "machado"
    iterations: int = 1000
    gaussians: int | None = None
    sh_degree: int | None = 0
    seed: int = 0
    drift: float = 0.0
    plans: Plans = field(default_factory=Plans)
    advised: bool = False

    @property
    def identity(self) -> Recipe:
        """Equal for recipes that give the same figures: all but the name."""
        return replace(self, label="")

    @property
    def geometry_key(self) -> str:
        """Equal for recipes with the same geometry; that of `joint` depends on the enhanced views as well."""
        fitted_to = self.enhancement_key if self.mode == "joint" else "photographs"
        fit = self.plans if self.mode == "joint" else (self.plans.lens, self.plans.training, self.plans.original)
        return repr((fitted_to, self.iterations, self.gaussians, self.sh_degree, self.seed, fit))

    @property
    def enhancement_key(self) -> str:
        """Equal for recipes with the same enhanced views."""
        return repr((self.enhancer, self.layer, self.simulation, self.drift, self.seed))

    def settings(self, capture: str, folder: str) -> Settings:
        """The product's settings for the recipe."""
        same = ("simulation", "mode", "iterations", "gaussians", "sh_degree", "seed")
        options = {name: getattr(self, name) for name in same}
        return Settings(capture, folder, layers=(self.layer,), blend=False, **options)


@dataclass(frozen=True)
class Trial:
    """The figures of a recipe on a capture; NaN where one could not be measured.

    Figures are means over the held-out views; see `core.color.metrics` and `WarpingError`.

    Attributes:
        capture, label, mode, enhancer, cvd, severity, seed, iterations: what was tried.
        gaussians, sh_degree: of the geometry.
        psnr, ssim: of the scene in the photographs' colours, against them.
        ccpr_input, ccpr_enhanced, ccpr_unenhanced, ccpr: CCPR of the photographs, of the enhanced photographs, of the
            scene in original colours, and of the mode's pictures.
        global_ccpr_input, global_ccpr: global CCPR of the photographs and the pictures.
        ccfr: of the pictures.
        ssim_input, ssim_simulated: SSIM of the photographs to the simulated photographs and pictures.
        natural_ssim, natural_psnr, delta_e: enhanced photographs against photographs, for normal vision.
        psnr_to_enhanced: of the pictures to the enhanced photographs, dB.
        rwe, rwe_absolute, rwe_long, rwe_normalised: warping error of the pictures: relative to the photographs, mean
            absolute, relative between views seven apart, relative in units of each side's standard deviation.
        rwe_enhanced, rwe_unenhanced: relative, of the enhanced photographs and of the scene in original colours.
        geometry_seconds, enhance_seconds, layer_seconds: wall time; work that recipes share is counted for each.
        processor_seconds: of all these together, of all threads.
        peak_memory_mb: of the process, which may have tried other recipes before.
        trial_seconds: wall time of the trial with its measurement; work that recipes share is counted for the first.
        skipped_steps: training steps skipped for numbers that were not finite.
        warnings: names of the product's warnings, separated by spaces; see `Recipe.advised`.
        decision: the reason for the number of Gaussians.
        decided_on_held_out: as of `TrainingResult`.
        error: why there are no figures; empty if there are.
    """

    capture: str
    label: str
    mode: str
    enhancer: str
    cvd: str
    severity: float
    seed: int
    iterations: int
    gaussians: int = 0
    sh_degree: int = 0
    psnr: float = NOT_MEASURED
    ssim: float = NOT_MEASURED
    ccpr_input: float = NOT_MEASURED
    ccpr_enhanced: float = NOT_MEASURED
    ccpr_unenhanced: float = NOT_MEASURED
    ccpr: float = NOT_MEASURED
    global_ccpr_input: float = NOT_MEASURED
    global_ccpr: float = NOT_MEASURED
    ccfr: float = NOT_MEASURED
    ssim_input: float = NOT_MEASURED
    ssim_simulated: float = NOT_MEASURED
    natural_ssim: float = NOT_MEASURED
    natural_psnr: float = NOT_MEASURED
    delta_e: float = NOT_MEASURED
    psnr_to_enhanced: float = NOT_MEASURED
    rwe: float = NOT_MEASURED
    rwe_absolute: float = NOT_MEASURED
    rwe_long: float = NOT_MEASURED
    rwe_normalised: float = NOT_MEASURED
    rwe_enhanced: float = NOT_MEASURED
    rwe_unenhanced: float = NOT_MEASURED
    geometry_seconds: float = NOT_MEASURED
    enhance_seconds: float = NOT_MEASURED
    layer_seconds: float = NOT_MEASURED
    processor_seconds: float = NOT_MEASURED
    peak_memory_mb: int = 0
    trial_seconds: float = NOT_MEASURED
    skipped_steps: int = 0
    warnings: str = ""
    decision: str = ""
    decided_on_held_out: bool = False
    error: str = ""

    @classmethod
    def failed(cls, capture: str, recipe: Recipe, error: str) -> Trial:
        """A trial without figures."""
        return cls(**described(capture, recipe), error=error)


def described(capture: str, recipe: Recipe) -> dict:
    """The fields of a `Trial` that describe what was tried."""
    return {
        "capture": capture,
        "label": recipe.label,
        "mode": recipe.mode,
        "enhancer": method_label(recipe.enhancer),
        "cvd": recipe.layer.cvd,
        "severity": recipe.layer.severity,
        "seed": recipe.seed,
        "iterations": recipe.iterations,
    }


def recipe_enhancer(recipe: Recipe) -> Enhancer:
    """The enhancer of a recipe, not fitted yet.

    Raises:
        InputError: an enhancer or an observer that does not exist.
    """
    observer = (recipe.layer.cvd, recipe.layer.severity, recipe.simulation)
    enhancer = method_factory(SCENE if recipe.enhancer == GAIN else recipe.enhancer, recipe.seed)(*observer)
    if recipe.enhancer == GAIN:
        enhancer = MatchedGain(enhancer, recipe.seed)
    return Drifting(enhancer, recipe.drift) if recipe.drift else enhancer


def with_derived(trials: pd.DataFrame) -> pd.DataFrame:
    """A frame of trials with the columns that tables add: ``seconds``, ``further_seconds`` (of a further layer) and
    ``added`` (RWE beyond that of the scene in original colours); what failed trials did not count becomes NaN.
    """
    further = trials.enhance_seconds + trials.layer_seconds
    return trials.assign(
        seconds=trials.geometry_seconds + further,
        further_seconds=further,
        added=trials.rwe - trials.rwe_unenhanced,
        gaussians=trials.gaussians.where(trials.gaussians > 0),
        peak_memory_mb=trials.peak_memory_mb.where(trials.peak_memory_mb > 0),
    )


def optimistic(runs: pd.DataFrame) -> list[str]:
    """The lines of a text about runs of a frame that the views decided about on which they were judged.

    Args:
        runs: ``capture`` and ``decided_on_held_out`` of each.
    """
    found = runs.groupby("capture", sort=False).decided_on_held_out.agg(decided="sum", all="size")
    some = [f"{mine.Index} ({mine.decided} of {mine.all} runs)" for mine in found[found.decided > 0].itertuples()]
    if not some:
        return []
    return [
        "Where training views were too few to hold some back, the held-out views, which the figures are of, also "
        "decided what a run began with, how far it grew, when it ended and which of its states was kept. Its figures "
        f"are slightly optimistic: {'; '.join(some)}.",
        "",
    ]


def failures(trials: pd.DataFrame) -> list[str]:
    """The lines of a text about the trials of a frame that gave no figures."""
    failed = trials[trials.error.fillna("") != ""].itertuples()
    lines = [f"- {trial.capture}, {trial.label}, seed {trial.seed}: {trial.error}" for trial in failed]
    return ["", "## What failed", "", *lines] if lines else []
