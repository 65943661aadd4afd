"""One way to make an enhanced scene, as `studies` vary it, and what one of them gave."""

from __future__ import annotations

from dataclasses import dataclass, field

from ...settings import Layer, Settings
from ...splats.layers import LayerPlan
from ...splats.plan import TrainingPlan
from ...splats.strategy import CloneSplitPrune
from ...stages import Plans
from ..enhancers.methods import method_label

DEUTAN = Layer("deutan", 1.0)
PLAIN = Plans(
    lens=None,
    training=TrainingPlan(strategy=CloneSplitPrune(), exposure=None, stopping=None, poses=None),
    layer=LayerPlan(multi_view_weight=0.0),
    guided=False,
)
"""Settings of plain Gaussian splatting: clone and split by gradients, every photograph, pixel and
camera taken as it is."""


@dataclass(frozen=True)
class Recipe:
    """The defaults are the product's, but for the length of the run.

    Attributes:
        label: what tables call it.
        mode: see `core.settings.MODES`.
        enhancer: one that `studies.enhancers` can make.
        layer: the observer.
        simulation: model behind the CVD simulation.
        iterations, gaussians, sh_degree: of the geometry, as in `Settings`.
        seed: of everything random.
        drift: standard deviation in degrees of a rotation of hue that differs from image to image: what an enhancer
            that contradicts itself does, in a known amount.
        plans: how the fits are done.
        advised: whether the run is looked at for warnings, as the product looks at its runs; a second evaluation where
            the subject is not ordinary.
    """

    label: str
    mode: str = "layers"
    enhancer: str = "lut"
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
    def geometry_key(self) -> str:
        """Equal for recipes whose geometry is the same; that of `joint` depends on the enhanced views as well."""
        fitted_to = self.enhancement_key if self.mode == "joint" else "photographs"
        fit = self.plans if self.mode == "joint" else (self.plans.lens, self.plans.training)
        return repr((fitted_to, self.iterations, self.gaussians, self.sh_degree, self.seed, fit))

    @property
    def enhancement_key(self) -> str:
        """Equal for recipes whose enhanced views are the same."""
        return repr((self.enhancer, self.layer, self.simulation, self.drift))

    def settings(self, capture: str, folder: str) -> Settings:
        """The product's settings for it."""
        return Settings(
            capture,
            folder,
            layers=(self.layer,),
            simulation=self.simulation,
            mode=self.mode,
            iterations=self.iterations,
            gaussians=self.gaussians,
            sh_degree=self.sh_degree,
            seed=self.seed,
            blend=False,
        )


NOT_MEASURED = float("nan")


@dataclass(frozen=True)
class Trial:
    """What a recipe gave on a capture; NaN where something could not be measured.

    Figures are means over the held-out views; see `core.color.metrics` and `WarpingError`.

    Attributes:
        capture, label, mode, enhancer, cvd, severity, seed, iterations: what was tried.
        gaussians, sh_degree: of the geometry.
        psnr, ssim: of the scene in the photographs' colours, against them.
        ccpr_input, ccpr_enhanced, ccpr_unenhanced, ccpr: contrast that is left of the photographs' in themselves, in
            the enhanced ones, in the scene in original colours, and in the mode's pictures.
        global_ccpr_input, global_ccpr: the same between pixels anywhere, of the photographs and the pictures.
        ccfr: share of the pictures' contrasts that were there before.
        ssim_input, ssim_simulated: SSIM of the photographs to themselves, and to the pictures, as the observer sees
            them.
        natural_ssim, natural_psnr, delta_e: enhanced photographs against photographs, for normal vision.
        psnr_to_enhanced: of the pictures, dB.
        rwe, rwe_absolute, rwe_long, rwe_normalised: warping error of the pictures: ratio to the photographs', mean
            absolute, ratio of views that are seven apart, ratio in units of each side's standard deviation.
        rwe_enhanced, rwe_unenhanced: ratio of the enhanced photographs, and of the scene in original colours.
        geometry_seconds, enhance_seconds, layer_seconds: wall time. Recipes share what they have in common, and each is
            charged for it.
        processor_seconds: of all these together and of all threads.
        peak_memory_mb: of the process, which may have made other recipes before.
        skipped_steps: that met numbers which are not finite.
        warnings: names of the warnings that the product gave, separated by spaces; see `Recipe.advised`.
        decision: what was said of the number of Gaussians.
        error: why there are no figures; empty where there are.
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
    skipped_steps: int = 0
    warnings: str = ""
    decision: str = ""
    error: str = ""

    @classmethod
    def failed(cls, capture: str, recipe: Recipe, error: str) -> Trial:
        """Without figures."""
        return cls(**described(capture, recipe), error=error)

    @property
    def seconds(self) -> float:
        """Wall time of everything but the evaluation."""
        return self.geometry_seconds + self.enhance_seconds + self.layer_seconds


def described(capture: str, recipe: Recipe) -> dict:
    """The fields of a `Trial` that say what was tried."""
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
