"""The stages of a run between its capture and its report: enhancement, geometry, colour layers, evaluation.

The modes differ in two of them:

    layers   geometry from the photographs, whose colours are then fitted to it once more; each layer's colours are
             fitted to the enhanced photographs, with the multi-view loss
    joint    geometry and the first layer's colours together from its enhanced photographs, with the multi-view loss;
             the photographs' colours and further layers are then fitted to that geometry
    post     geometry from the photographs; a layer's pictures are renderings that are enhanced one by one afterwards,
             and its Gaussians carry the colours that fit those pictures best, which is what Blender can show of them
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..capture.model import Capture, View
from ..color.matrices import linear_simulation
from ..consistency import SceneAgreement, SceneCorrespondences
from ..enhance import Enhancer, enhance_bytes
from ..evaluate.evaluation import Evaluation, SceneMatches, Split, enhanced_path, render_path
from ..files.images import read_png, write_png
from ..runs.layout import GAUSSIANS_FILE, layer_gaussians_file
from ..runtime.protocol import Reporter, StageSpan
from ..runtime.resources import return_freed_memory
from ..settings import Layer, Settings
from ..splats import raster
from ..splats.gaussians import Gaussians
from ..splats.io.ply import write_ply
from ..splats.renderer import SceneRenderer
from ..splats.targets import Background
from ..splats.training.checkpoints import Checkpoints
from ..splats.training.joint import JointPlan, JointTraining
from ..splats.training.layers import LayerPlan, fit_layer
from ..splats.training.lens import LensPlan
from ..splats.training.losses import SeenContrast, ViewGuide
from ..splats.training.plan import TrainingPlan, TrainingResult
from ..splats.training.trainer import Trainer
from .cleaning import Cleaned, clean, look
from .enhancement import enhance_views
from .guides import view_guides
from .preview import Preview, PreviewedTraining

# What readers of the report have to know about a mode.
MODE_NOTES = {
    "joint": {
        "curve": "the PSNR is measured against enhanced held-out views, because the geometry was fitted to such views"
    },
    "post": {
        "layers": "the pictures and figures of a layer are those of renderings that were enhanced one by one; its "
        "Gaussians have the colours that fit these pictures best"
    },
}

# Fractions of a stage that its parts end at, about: of the geometry's, training and the matching of its views; of a
# layer's, the comparison of its views. The more photographs there are, the more the later parts take.
_TRAINED, _MATCHED, _COMPARED = 0.88, 0.94, 0.3

Image = NDArray[np.uint8]
Picture = Callable[[int], Image]
"""Index of a view to how a layer looks from there, (H, W, 3) sRGB."""


@dataclass(frozen=True)
class Reconstruction:
    """A geometry with colours.

    Attributes:
        original: in the photographs' colours.
        correspondences: between the views, by its depth; shared by all that compare views.
        agreement: of the training views.
        layers: whose colours came with the geometry.
    """

    original: Gaussians
    correspondences: SceneCorrespondences
    agreement: SceneAgreement
    layers: dict[Layer, Gaussians] = field(default_factory=dict)


@dataclass(frozen=True)
class Plans:
    """How the fits are done where the settings leave it open; comparisons vary it.

    Attributes:
        lens: how the cameras' focal length is looked at, and their poses in scenes as small; None takes both as given.
        training: of the geometry; steps, limit, SH degree and poses are those of the settings.
        joint: of the last part of a joint training.
        layer: of a layer's colours.
        original: of the photographs' colours on the finished geometry; None keeps those that it was trained with.
        guided: whether pixels that vary with the view count less, and the views agree on colours.
    """

    lens: LensPlan | None = field(default_factory=LensPlan)
    training: TrainingPlan = field(default_factory=TrainingPlan)
    joint: JointPlan = field(default_factory=JointPlan)
    layer: LayerPlan = field(default_factory=LayerPlan)
    original: LayerPlan | None = field(default_factory=LayerPlan.of_photographs)
    guided: bool = True


@dataclass(frozen=True)
class Stages:
    """Shared context and steps of one run after the capture was read."""

    settings: Settings
    folder: Path
    reporter: Reporter
    capture: Capture
    split: Split
    rasterizer: raster.Rasterizer
    background: Background
    scene: SceneRenderer
    preview: Preview | None = None
    plans: Plans = field(default_factory=Plans)
    checkpoints: Checkpoints | None = None

    @classmethod
    def of(
        cls,
        settings: Settings,
        folder: Path,
        reporter: Reporter,
        capture: Capture,
        split: Split,
        rasterizer: raster.Rasterizer,
        *,
        previews: bool = False,
        plans: Plans | None = None,
        checkpoints: Checkpoints | None = None,
    ) -> Stages:
        """The stages of a run on `capture` whose files go into `folder`.

        Args:
            previews: show how far they are.
            checkpoints: of the geometry; None keeps none.
        """
        background = Background.of(capture.views)
        scene = SceneRenderer(rasterizer, capture.views, background)
        shown = split.test or split.train
        preview = Preview(scene, shown[len(shown) // 2], folder, reporter) if previews else None
        plans = plans or Plans()
        return cls(
            *(settings, folder, reporter, capture, split, rasterizer, background, scene, preview, plans, checkpoints)
        )

    def show_points(self) -> None:
        """A first picture, long before that of a training: what the capture's sparse points show."""
        if self.preview is not None:
            self.preview.show_points(self.capture.points, self.capture.point_colors)

    def end_previews(self) -> None:
        """Leave no picture behind that is not a result."""
        if self.preview is not None:
            self.preview.remove()

    def on(self, capture: Capture) -> Stages:
        """The stages that follow, on the capture with other cameras, or less to look at."""
        scene = SceneRenderer(self.rasterizer, capture.views, self.background)
        preview = self.preview and self.preview.of(scene)
        return replace(self, capture=capture, scene=scene, preview=preview)

    def enhance(self, enhancers: dict[Layer, Enhancer]) -> None:
        """Write ``enhanced/<layer>/<view>.png`` for every view; the enhancers are fitted to the training views only.

        The scene's LUT is also written as ``layer.<layer>.cube``, for grading tools, and its network as
        ``layer.<layer>.safetensors``.
        """
        enhance_views(enhancers, self.capture.views, self._views(self.split.train), self.folder, self.reporter)

    def train(self) -> TrainingResult:
        """Fit the geometry."""
        if self.settings.mode == "joint":
            return self._train_jointly(self.settings.layers[0])
        return self._train_on_photographs()

    def after(self, result: TrainingResult) -> Stages:
        """The stages that follow, on the capture with the poses and the motion blur that training found.

        What training left out, because it moves, they do not look at either.
        """
        if not (result.moved_poses or result.smears or result.moving):
            return self
        corrected = self.capture.moved(result.moved_poses).smeared(result.smears)
        return self.on(corrected.without(result.moving))

    def clean(self, result: TrainingResult) -> Cleaned:
        """What training gave, scored and without the floaters that the settings ask to remove."""
        self.reporter.status("geometry", "looking for floaters")
        sightings = look(self.rasterizer, result.gaussians, self._views(self.split.train), self.background)
        # Joint training's colours are enhanced, so photographs do not tell its quality.
        compared = [] if self.settings.mode == "joint" else self.split.test
        return clean(result.gaussians, sightings, self.settings.clean, self.scene, compared)

    def reconstruct(self, result: TrainingResult, scores: NDArray[np.float32] | None = None) -> Reconstruction:
        """What training gave, with its views matched; writes ``splats.ply`` in the photographs' colours.

        Args:
            scores: (N,) of the Gaussians, how much they look like floaters; written with them.
        """
        made = self.reconstruction(result.gaussians, "geometry", _TRAINED, _MATCHED)
        if self.settings.mode == "joint":
            layers = {self.settings.layers[0]: result.gaussians}
            made = replace(made, original=self._fit_original(made, self.plans.layer), layers=layers)
        elif self.plans.original is not None and result.gaussians.sh_degree == 0:
            made = replace(made, original=self._fit_original(made, self.plans.original))
        write_ply(self.folder / GAUSSIANS_FILE, made.original, scores)
        return made

    def reconstruction(self, gaussians: Gaussians, stage: str, start: float, end: float) -> Reconstruction:
        """A geometry that is there already, with its views matched, which takes the stage from `start` to `end`."""
        message = "matching points between views"
        self.reporter.status(stage, message)
        span = StageSpan(self.reporter, stage, start, end, message)
        correspondences = SceneCorrespondences(self.capture.views, lambda index: self.scene.depth(gaussians, index))
        photographs = {i: self.capture.views[i].image for i in self.split.train}
        agreement = SceneAgreement(correspondences, photographs, reporter=span)
        return Reconstruction(gaussians, correspondences, agreement)

    def fit_layers(self, made: Reconstruction, enhancers: dict[Layer, Enhancer]) -> dict[Layer, Picture]:
        """Make each layer's Gaussians; writes ``splats.<layer>.ply``. Returns how the layers look."""
        pictures: dict[Layer, Picture] = {}
        for done, (layer, enhancer) in enumerate(enhancers.items()):
            message = f"{layer.name}: fitting colours"
            self.reporter.status("layers", message)
            span = StageSpan(self.reporter, "layers", done / len(enhancers), (done + 1) / len(enhancers), message)
            gaussians = self.fit_layer(made, layer, enhancer, span)
            write_ply(self.folder / layer_gaussians_file(layer.name), gaussians)
            if self.preview is not None:
                self.preview.show(gaussians)
            pictures[layer] = self._picture(layer, gaussians)
        return pictures

    def evaluate(self, made: Reconstruction, pictures: dict[Layer, Picture]) -> dict[str, Any]:
        """The report's figures; writes ``renders/``."""
        evaluation = Evaluation(
            self.capture, self.split, self.settings.simulation, self.scene, self.folder, self.reporter
        )
        matches = SceneMatches.find(made.correspondences)
        figures = evaluation.run(made.original, pictures, matches)
        figures["notes"] |= MODE_NOTES.get(self.settings.mode, {})
        return figures

    def _train_on_photographs(self) -> TrainingResult:
        reporter = self._watching()
        trainer = Trainer(
            self.rasterizer,
            self._views(self.split.train),
            self._views(self.split.test),
            self.capture.points,
            self.capture.point_colors,
            self._training_plan(),
            self.background,
            self.settings.seed,
            self.checkpoints,
            reporter,
        )
        return trainer.train(reporter)

    def _watching(self) -> Reporter:
        """What training reports to."""
        shown = self.reporter if self.preview is None else PreviewedTraining(self.reporter, self.preview)
        return StageSpan(shown, "geometry", 0.0, _TRAINED, None, tells_status=True)

    def _train_jointly(self, layer: Layer) -> TrainingResult:
        """Geometry and colours from the layer's enhanced views, every side in the same colours."""
        training = JointTraining(
            self.rasterizer,
            self._views_from(enhanced_path, layer, self.split.train),
            self._views_from(enhanced_path, layer, self.split.test),
            replace(self._training_plan(), sh_degree=0),
            self.plans.joint,
            self.background,
            self.settings.seed,
            self._contrast(layer),
            self.checkpoints,
        )

        def guides_of(first: TrainingResult) -> Sequence[ViewGuide] | None:
            stages = self.after(first)
            turn = _TRAINED * (1.0 - self.plans.joint.share)
            made = stages.reconstruction(first.gaussians, "geometry", turn, turn)
            return stages._guides(made.agreement, training.views)

        return training.train(self.capture.points, self.capture.point_colors, guides_of, self._watching())

    def _training_plan(self) -> TrainingPlan:
        return replace(
            self.plans.training,
            steps=self.settings.iterations,
            limit=self.settings.gaussians,
            sh_degree=self.settings.sh_degree,
            poses=self.plans.training.poses if self.settings.corrects_poses else None,
        )

    def fit_layer(self, made: Reconstruction, layer: Layer, enhancer: Enhancer, reporter: Reporter) -> Gaussians:
        """A layer's Gaussians: those that came with the geometry, else it with colours that are fitted to it."""
        if layer in made.layers:
            return made.layers[layer]
        train = self.split.train
        if self.settings.mode == "post":
            self._enhance_renderings(made.original, layer, enhancer)
            # A rendering has its background in it, and no motion blur.
            views = [replace(view, alpha=None, smear=None) for view in self._views_from(render_path, layer, train)]
        else:
            views = self._views_from(enhanced_path, layer, train)
        post = self.settings.mode == "post"  # the baseline: colours that fit the pictures, and nothing more
        comparing, fitting = (
            StageSpan(reporter, "layers", *ends, None) for ends in ((0.0, _COMPARED), (_COMPARED, 1.0))
        )
        guides = self._guides(made.agreement, None if post else views, comparing)
        contrast = None if post else self._contrast(layer)
        return self._fit_colors(made, views, guides, self.plans.layer, contrast, partial(fitting.progress, "layers"))

    def _fit_original(self, made: Reconstruction, plan: LayerPlan) -> Gaussians:
        """The geometry with colours of SH degree 0 fitted to the photographs, as they look to normal vision."""
        message = "fitting the photographs' colours"
        self.reporter.status("geometry", message)
        span = StageSpan(self.reporter, "geometry", _MATCHED, 1.0, message)
        views, guides = self._views(self.split.train), self._guides(made.agreement)
        contrast = SeenContrast(plan.contrast, views, None)
        return self._fit_colors(made, views, guides, plan, contrast, partial(span.progress, "geometry"))

    def _fit_colors(
        self,
        made: Reconstruction,
        views: Sequence[View],
        guides: Sequence[ViewGuide] | None,
        plan: LayerPlan,
        contrast: SeenContrast | None,
        progress: Callable[[float], None],
    ) -> Gaussians:
        return_freed_memory()  # that of matching: no stage needs more than this one
        seed = self.settings.seed
        return fit_layer(self.rasterizer, made.original, views, plan, self.background, seed, progress, guides, contrast)

    def _contrast(self, layer: Layer) -> SeenContrast:
        """What is to be kept of the training views' contrast for a layer's observer."""
        observer = linear_simulation(layer.cvd, layer.severity, self.settings.simulation)
        return SeenContrast(self.plans.layer.contrast, self._views(self.split.train), observer)

    def _guides(
        self, agreement: SceneAgreement, enhanced: Sequence[View] | None = None, reporter: Reporter | None = None
    ) -> list[ViewGuide] | None:
        """For each training view the weights of its pixels, and with `enhanced` training views their consensus."""
        if not self.plans.guided:
            return None
        return view_guides(agreement, self.capture.views, self.split.train, self.background, enhanced, reporter)

    def _enhance_renderings(self, original: Gaussians, layer: Layer, enhancer: Enhancer) -> None:
        """Write ``renders/<layer>/<view>.png`` for every view: the original colours' rendering, enhanced on its own."""
        for index, view in enumerate(self.capture.views):
            picture = enhance_bytes(enhancer, self.scene.color(original, index))
            write_png(render_path(self.folder, layer, view), picture)

    def _picture(self, layer: Layer, gaussians: Gaussians) -> Picture:
        if self.settings.mode == "post":
            return lambda index: read_png(render_path(self.folder, layer, self.capture.views[index]))
        return lambda index: self.scene.color(gaussians, index)

    def _views(self, indices: Sequence[int]) -> list[View]:
        return [self.capture.views[i] for i in indices]

    def _views_from(
        self, place: Callable[[Path, Layer, View], Path], layer: Layer, indices: Sequence[int]
    ) -> list[View]:
        """The views with the layer's images of `place` instead of the photographs."""
        return [replace(view, image=read_png(place(self.folder, layer, view))) for view in self._views(indices)]
