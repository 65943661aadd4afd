"""The colour LUT: interpolation, exchange formats and files that are not what they claim."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
import torch
from safetensors.torch import save_file
from scipy.interpolate import RegularGridInterpolator

from cvdgs.core.enhance.lut import ColorLut, interpolate
from cvdgs.core.errors import InputError

from ...effort import function_calls


def random_lut(nodes: int = 9, amplitude: float = 0.2, seed: int = 0) -> ColorLut:
    generator = torch.Generator().manual_seed(seed)
    return ColorLut(amplitude * (torch.rand(nodes, nodes, nodes, 3, generator=generator) - 0.5), {"cvd": "deutan"})


def random_image(height: int = 20, width: int = 30, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def test_interpolation_agrees_with_scipy() -> None:
    lut, colors = random_lut(), np.random.default_rng(1).random((500, 3))
    axis = np.linspace(0, 1, 9)
    expected = RegularGridInterpolator((axis, axis, axis), lut.residual.double().numpy())(colors)
    actual = interpolate(lut.residual.double(), torch.from_numpy(colors)[None])[0].numpy()
    np.testing.assert_allclose(actual, expected, atol=1e-12)


def test_a_zero_table_is_the_identity_for_bytes_and_floats() -> None:
    lut, image = ColorLut(torch.zeros(9, 9, 9, 3)), random_image()
    np.testing.assert_array_equal(lut(image), image.astype(np.float32) / np.float32(255))
    floats = np.random.default_rng(0).random((5, 7, 3), dtype=np.float32)
    np.testing.assert_array_equal(lut(floats), floats)


def test_strength_blends_between_the_image_and_the_full_result() -> None:
    lut, image = random_lut(), random_image()
    original, full = image.astype(np.float32) / 255, lut(image)
    np.testing.assert_array_equal(lut(image, 0.0), original)
    np.testing.assert_allclose(lut(image, 0.3), original + 0.3 * (full - original), atol=1e-6)


def test_the_result_stays_in_gamut_and_the_input_is_not_changed() -> None:
    image = random_image()
    before = image.copy()
    result = random_lut(amplitude=3.0)(image)
    assert result.dtype == np.float32
    assert result.min() >= 0.0
    assert result.max() <= 1.0
    np.testing.assert_array_equal(image, before)


def test_one_colour_gets_the_same_result_wherever_it_is() -> None:
    lut, image = random_lut(), random_image(64, 48)
    shuffled = image.reshape(-1, 3)[np.random.default_rng(0).permutation(64 * 48)]
    by_color = {tuple(c): r for c, r in zip(image.reshape(-1, 3), lut(image).reshape(-1, 3), strict=True)}
    for color, result in zip(shuffled, lut(shuffled.reshape(1, -1, 3))[0], strict=True):
        np.testing.assert_allclose(result, by_color[tuple(color)], atol=1e-6)


@pytest.mark.filterwarnings("ignore:.*Matplotlib")
def test_an_exported_cube_reads_back_in_colour_science_as_the_same_map(tmp_path: Path) -> None:
    from colour import read_LUT

    lut = random_lut()
    lut.export_cube(tmp_path / "scene.cube", strength=0.8, title='deutan "1.0"')
    cube = read_LUT(str(tmp_path / "scene.cube"))
    assert cube.size == 33
    assert cube.name == "deutan 1.0"
    nodes = np.random.default_rng(0).integers(0, 33, (1, 50, 3)) / 32
    expected = lut(nodes.astype(np.float32), 0.8)
    np.testing.assert_allclose(cube.apply(nodes), expected, atol=2e-6)


def test_an_exported_cube_reads_back_in_opencolorio_as_the_same_map(tmp_path: Path) -> None:
    lut, nodes = random_lut(), np.random.default_rng(1).integers(0, 33, (4, 25, 3)).astype(np.float32) / 32
    lut.export_cube(tmp_path / "scene.cube")
    image = oiio.ImageBuf(oiio.ImageSpec(25, 4, 3, oiio.FLOAT))
    image.set_pixels(oiio.ROI(), nodes)
    # Not the configuration of Blender's module, which other tests of this process may have loaded.
    graded = oiio.ImageBufAlgo.ociofiletransform(image, str(tmp_path / "scene.cube"), colorconfig="ocio://default")
    assert not graded.has_error, graded.geterror()
    np.testing.assert_allclose(graded.get_pixels(oiio.FLOAT), lut(nodes), atol=2e-6)


def test_a_saved_lut_loads_with_its_description(tmp_path: Path) -> None:
    lut = random_lut()
    lut.save(tmp_path / "lut.safetensors")
    loaded = ColorLut.load(tmp_path / "lut.safetensors")
    assert torch.equal(loaded.residual, lut.residual)
    assert loaded.description == {"cvd": "deutan"}


def _truncated(path: Path) -> None:
    random_lut().save(path)
    path.write_bytes(path.read_bytes()[:-100])


def _not_finite(path: Path) -> None:
    lut = random_lut()
    lut.residual[0, 0, 0, 0] = float("nan")
    lut.save(path)


FORMAT = {"format": "cvdgs-color-lut"}
DAMAGE = {
    "missing": lambda path: None,
    "empty": lambda path: path.write_bytes(b""),
    "text": lambda path: path.write_text("LUT_3D_SIZE 9"),
    "huge header": lambda path: path.write_bytes(struct.pack("<Q", 1 << 60) + b"{}"),
    "truncated": _truncated,
    "other weights": lambda path: save_file({"residual": torch.zeros(9, 9, 9, 3)}, path),
    "no table": lambda path: save_file({"weight": torch.zeros(9, 9, 9, 3)}, path, FORMAT),
    "wrong shape": lambda path: save_file({"residual": torch.zeros(9, 9, 3)}, path, FORMAT),
    "not finite": _not_finite,
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE.keys())
def test_a_file_that_is_not_a_lut_is_refused_in_one_line(damage, tmp_path: Path) -> None:
    path = tmp_path / "lut.safetensors"
    damage(path)
    with pytest.raises(InputError, match="LUT") as refusal:
        ColorLut.load(path)
    assert refusal.value.where == str(path)
    assert "\n" not in str(refusal.value)


def test_more_pixels_take_no_more_calls() -> None:
    lut = random_lut()
    small, large = random_image(20, 30), random_image(360, 480)
    assert function_calls(lambda: lut(large)) < 2 * function_calls(lambda: lut(small))
