"""Sets of Gaussians and evidence about them, for the tests of strategies."""

import numpy as np

from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.strategy import ViewEvidence, ViewEvidenceSum


def gaussians(count: int, size: float = 0.001, opacity_logit: float = 2.0, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)
    return Gaussians(
        means=rng.standard_normal((count, 3)).astype(np.float32),
        log_scales=np.full((count, 3), np.log(size), np.float32),
        quaternions=rng.standard_normal((count, 4)).astype(np.float32),
        opacity_logits=np.full(count, opacity_logit, np.float32),
        sh=rng.standard_normal((count, 1, 3)).astype(np.float32),
    )


def opinions(weight, mean_error, threshold=0.1, distance=None, complete=True) -> ViewEvidence:
    """Evidence of views that show Gaussians with (V, N) weights and mean errors, from (V, N) distances or from 1."""
    weight, mean_error = np.asarray(weight, np.float32), np.asarray(mean_error, np.float32)
    distance = np.ones_like(weight) if distance is None else np.asarray(distance, np.float32)
    total = ViewEvidenceSum(weight.shape[1])
    for w, e, d in zip(weight, mean_error, distance, strict=True):
        total.add(w, w * e, threshold, d)
    return total.evidence(complete)
