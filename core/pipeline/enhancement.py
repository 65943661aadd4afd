"""The stage of a run that recolours its photographs: each enhancer is fitted to the training views, applied to all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from ..capture.model import View
from ..enhance import (
    Enhancer,
    LutEnhancer,
    SceneEnhancer,
    SceneNetworkEnhancer,
    enhance_bytes,
    enhance_finite,
    learns,
    warn_not_finite,
)
from ..evaluate.evaluation import enhanced_path
from ..files.images import write_png
from ..runs.layout import layer_cube_file, layer_network_file
from ..runtime.protocol import Reporter, StageSpan
from ..settings import Layer

STAGE = "enhance"
# A LUT's fit takes as long as applying it to so many views of 640 pixels.
_LUT_FIT_VIEWS = 100
_NETWORK_FIT_VIEWS = 20  # the same fit, but applying takes longer


def enhance_views(
    enhancers: Mapping[Layer, Enhancer],
    views: Sequence[View],
    training: Sequence[View],
    folder: Path,
    reporter: Reporter,
) -> None:
    """Write ``enhanced/<layer>/<view>.png`` of all `views`, and what was fitted (see `Stages.enhance`).

    Args:
        training: of the views, what the enhancers are fitted to.
        folder: of the run.
    """
    costs = {layer: _fit_cost(enhancer) for layer, enhancer in enhancers.items()}
    total, done = sum(costs.values()) + len(enhancers) * len(views), 0
    for layer, enhancer in enhancers.items():
        reporter.status(STAGE, f"{layer.name}: fitting the enhancer")
        ends = done / total, (done + costs[layer]) / total
        span = StageSpan(reporter, STAGE, *ends, f"{layer.name}: fitting")
        enhancer.fit([view.image for view in training], span, alphas=[view.shown for view in training])
        _write_fitted(enhancer, layer, folder)
        done += costs[layer]
        broken = 0
        for view in views:
            enhanced, spoilt = enhance_finite(enhancer, view.image, view.alpha)
            broken += spoilt
            write_png(enhanced_path(folder, layer, view), enhanced)
            if view.again is not None:
                enhanced = enhance_bytes(enhancer, view.again, view.alpha)
                write_png(enhanced_path(folder, layer, view, again=True), enhanced)
            done += 1
            reporter.progress(STAGE, done / total, f"{layer.name}: {view.key}")
        warn_not_finite(reporter, layer.name, broken)


def _write_fitted(enhancer: Enhancer, layer: Layer, folder: Path) -> None:
    if isinstance(enhancer, SceneEnhancer) and enhancer.lut is not None:
        enhancer.export_cube(folder / layer_cube_file(layer.name), f"cvdgs {layer.name}")
    if isinstance(enhancer, SceneNetworkEnhancer) and not enhancer.is_identity:
        enhancer.save(folder / layer_network_file(layer.name))


def _fit_cost(enhancer: Enhancer) -> int:
    """As how many applications to a view a fit counts for the progress."""
    if not learns(enhancer):
        return 0
    return _LUT_FIT_VIEWS if isinstance(enhancer, LutEnhancer) else _NETWORK_FIT_VIEWS
