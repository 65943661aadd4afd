"""The network's result depends on colours and surroundings alone, in pieces as in whole, in little memory."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.color.simulation import Observer
from cvdgs.core.color.spaces import image_to_tensor
from cvdgs.core.enhance.scene.application import recolour
from cvdgs.core.enhance.scene.network import SceneNetwork, features, interpolation, table_lut


def random_network(seed: int = 0, cvd: str = "deutan") -> SceneNetwork:
    generator = torch.Generator().manual_seed(seed)
    network = SceneNetwork(Observer(cvd, 1.0)).requires_grad_(False)
    for values in network.parameters():
        values.normal_(0.0, 0.3, generator=generator)
    return network


def noise(height: int, width: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)


def recoloured(network: SceneNetwork, image: np.ndarray, alpha: np.ndarray | None = None, **options) -> np.ndarray:
    result = np.empty(image.shape, np.float32)
    recolour(network, image, result, alpha, **options)
    return result


def whole(network: SceneNetwork, image: np.ndarray, alpha: np.ndarray | None = None) -> np.ndarray:
    """The result by the features that the fit uses, for an image that is small enough for them."""
    pixels = image_to_tensor(image)
    coverage = None if alpha is None else torch.from_numpy(alpha).float() / 255.0
    shown = network(pixels.flatten(1).T, features(pixels, network.observer, coverage))
    return shown.T.reshape(pixels.shape).clamp(0.0, 1.0).permute(1, 2, 0).numpy()


@given(st.integers(1, 50), st.integers(1, 50), st.integers(7, 40), st.booleans())
@settings(max_examples=15, deadline=None)
def test_tiles_of_any_size_give_what_the_whole_gives(height: int, width: int, tile_side: int, cut_out: bool) -> None:
    network, image = random_network(), noise(height, width)
    alpha = noise(height, width, 1)[..., 0] // 86 * 127 if cut_out else None
    result = recoloured(network, image, alpha, tile_side=tile_side)
    np.testing.assert_allclose(result, whole(network, image, alpha), atol=2e-6)


def test_tiles_of_an_image_that_is_reduced_for_its_surroundings_leave_no_seam() -> None:
    network, image = random_network(), noise(300, 700)
    np.testing.assert_allclose(
        recoloured(network, image, tile_side=64), recoloured(network, image, tile_side=1000), atol=2e-6
    )


def test_a_photograph_at_twice_the_size_gets_the_same_colours() -> None:
    network, image = random_network(), noise(40, 60).repeat(8, 0).repeat(8, 1)
    larger = image.repeat(2, 0).repeat(2, 1)
    result = recoloured(network, image)
    difference = np.abs(recoloured(network, larger)[::2, ::2] - result)
    assert difference.mean() < 0.05 * np.abs(result - image / 255.0).mean()


def test_greys_stay_whatever_surrounds_them() -> None:
    image = noise(32, 32)
    image[8:16] = image[8:16, :, :1]
    np.testing.assert_array_equal(recoloured(random_network(), image)[8:16], image[8:16].astype(np.float32) / 255.0)


def test_strength_is_the_way_from_the_image_to_the_result() -> None:
    network, image = random_network(), noise(20, 30)
    np.testing.assert_array_equal(recoloured(network, image, strength=0.0), image.astype(np.float32) / 255.0)
    half = (image / 255.0 + recoloured(network, image)) / 2.0
    np.testing.assert_allclose(recoloured(network, image, strength=0.5), half, atol=1e-6)


def test_what_is_not_covered_surrounds_nothing() -> None:
    network, image = random_network(), noise(64, 64)
    alpha = np.zeros((64, 64), np.uint8)
    alpha[16:40, 8:50] = 255
    other = np.where(alpha[..., None] > 0, image, 17).astype(np.uint8)
    first, second = (recoloured(network, one, alpha)[alpha > 0] for one in (image, other))
    np.testing.assert_allclose(first, second, atol=1e-6)
    assert np.abs(recoloured(network, other)[alpha > 0] - first).max() > 0.01  # it would, if it were covered


def test_scaling_the_change_moves_each_colour_by_that_part_of_its_way() -> None:
    network, image = random_network(), torch.rand(50, 3, generator=torch.Generator().manual_seed(0))
    seen = torch.rand(50, 25, generator=torch.Generator().manual_seed(1))
    full = network(image, seen) - image
    network.scale(0.4)
    torch.testing.assert_close(network(image, seen) - image, 0.4 * full)


def test_the_lut_is_the_table_with_its_gate() -> None:
    network = random_network()
    image = (np.random.default_rng(0).integers(0, 33, (10, 10, 3)) / 32.0).astype(np.float32)  # nodes of the LUT
    expected = network(torch.from_numpy(image).reshape(-1, 3)).clamp(0.0, 1.0).reshape(10, 10, 3)
    np.testing.assert_allclose(table_lut(network.table)(image), expected, atol=1e-5)


@pytest.mark.parametrize(("side", "cells"), [(1, 1), (7, 1), (30, 4), (4, 4)])
def test_enlarging_is_bilinear(side: int, cells: int) -> None:
    values = torch.rand(1, 1, cells, 1, generator=torch.Generator().manual_seed(0))
    expected = torch.nn.functional.interpolate(values, (side, 1), mode="bilinear", align_corners=False).flatten()
    torch.testing.assert_close(interpolation(0, side, side, cells) @ values.flatten(), expected)
    torch.testing.assert_close(
        interpolation(side // 2, side, side, cells), interpolation(0, side, side, cells)[side // 2 :]
    )


PEAK_PROGRAM = """
import resource, sys
import numpy as np
from cvdgs.core.color.simulation import Observer
from cvdgs.core.enhance.scene.application import recolour
from cvdgs.core.enhance.scene.network import SceneNetwork
network = SceneNetwork(Observer("deutan", 1.0)).requires_grad_(False)
def peak(side):
    image = np.zeros((side, side, 3), np.uint8)
    recolour(network, image, image)  # in place: the image is all there is
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - 3 * side * side // 1024
small = peak(400)
print(peak(int(sys.argv[1])) - small)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss is in kB on Linux alone")
@pytest.mark.parametrize("side", [1200, pytest.param(10_000, marks=pytest.mark.slow)])
def test_memory_grows_with_the_tile_and_not_with_the_photograph(side: int) -> None:
    command = [sys.executable, "-c", PEAK_PROGRAM, str(side)]
    result = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    # kB; a float32 copy of 1.4 megapixels alone would be 17,000, and of 100 megapixels 1,200,000.
    assert int(result.stdout) < (9_000 if side < 10_000 else 60_000)
