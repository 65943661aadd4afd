"""The embedded demo capture, enhanced by the default settings, becomes distinct enough for the layer made from it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

import cvdgs.core.demo
from cvdgs.core.color.metrics import contrast_scores, naturalness
from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.spaces import image_to_tensor
from cvdgs.core.enhance import make_enhancer

PHOTOGRAPHS = sorted((Path(cvdgs.core.demo.__file__).parent / "showroom" / "images").glob("*.jpg"))

pytestmark = pytest.mark.skipif(not PHOTOGRAPHS, reason="the demo capture has not been made")


def read(path: Path) -> np.ndarray:
    return np.ascontiguousarray(oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)[..., :3])


def test_held_out_views_of_the_showroom_gain_contrast_and_still_look_like_it() -> None:
    held_out = [read(path) for path in PHOTOGRAPHS[::8]]
    enhancer = make_enhancer("lut", "deutan", 1.0)
    enhancer.fit([read(path) for number, path in enumerate(PHOTOGRAPHS) if number % 8])
    gains, kept, natural = [], [], []
    for photograph in held_out[:3]:
        original, enhanced = image_to_tensor(photograph), image_to_tensor(enhancer(photograph))
        before, after = (contrast_scores(original, simulate(x, "deutan", 1.0)) for x in (original, enhanced))
        gains.append(after.ccpr - before.ccpr)
        kept.append(after.ccfr)
        natural.append(naturalness(original, enhanced))
    # The rendered layer has to gain 0.10; reconstruction smooths some contrast away, so the views must gain more.
    assert np.mean(gains) > 0.2
    assert np.mean(kept) > 0.85
    assert np.mean([scores.ssim for scores in natural]) > 0.95
    assert np.mean([scores.delta_e_2000 for scores in natural]) < 6.0
