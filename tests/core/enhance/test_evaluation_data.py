"""On photographs that nothing was tuned to, the LUT keeps more contrast than none and invents less than a gain."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
import torch

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.color.metrics import ContrastScores, contrast_scores, naturalness
from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.spaces import image_to_tensor
from cvdgs.core.enhance.lut_fit import fit_lut
from cvdgs.scripts.benchmarks.baselines import ContrastGain

PHOTOS = ROOT.parent / "shared" / "data" / "photos"
# Photographs whose input CCPR (deutan, τ = 6) is below 0.9.
HARD = ("kodak/kodim02.png", "kodak/kodim04.png", "produce/blueberry.jpg", "produce/sweet_pepper.jpg")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not PHOTOS.is_dir(), reason="the evaluation photographs are not here"),
]


def read(path: Path, short_side: int = 256) -> np.ndarray:
    pixels = torch.from_numpy(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)[..., :3]).permute(2, 0, 1)[None]
    scale = short_side / min(pixels.shape[2:])
    reduced = torch.nn.functional.interpolate(pixels, scale_factor=scale, mode="bilinear", antialias=True)[0]
    return (reduced.clamp(0, 1).permute(1, 2, 0).numpy() * 255).round().astype(np.uint8)


def test_hard_photographs_keep_more_contrast_and_invent_less_than_with_a_gain_as_strong() -> None:
    scores: dict[str, list[ContrastScores]] = {"none": [], "gain": [], "lut": []}
    changes = []
    for name in HARD:
        photograph = read(PHOTOS / name)
        original, lut = image_to_tensor(photograph), fit_lut([photograph], "deutan", 1.0)
        changes.append(naturalness(original, image_to_tensor(lut(photograph))).delta_e_76)
        gain = ContrastGain(changes[-1])
        gain.fit([photograph])
        for control, result in (("none", photograph), ("gain", gain(photograph)), ("lut", lut(photograph))):
            scores[control].append(contrast_scores(original, simulate(image_to_tensor(result), "deutan", 1.0)))

    def mean(control: str, figure: str) -> float:
        return float(np.mean([getattr(score, figure) for score in scores[control]]))

    assert mean("lut", "ccpr") > mean("none", "ccpr") + 0.05
    assert mean("lut", "ccpr") > mean("gain", "ccpr")
    assert mean("lut", "ccfr") > mean("gain", "ccfr") + 0.01
    assert np.mean(changes) < 6.0
