"""Masks say what of a photograph is looked at, wherever they come from, and follow it through everything."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cvdgs.core.capture.masks import resized_mask
from cvdgs.core.capture.model import Capture
from cvdgs.core.capture.normalised import write_capture
from cvdgs.core.capture.reader import inspect_capture, read_capture
from cvdgs.core.capture.sfm_images import MASKS, copy_name, copy_photographs
from cvdgs.core.capture.sfm_job import SfmJob, SfmSettings
from cvdgs.core.errors import InputError

from .make_captures import (
    Shot,
    frames,
    intrinsics,
    pinhole,
    save,
    save_images,
    shots,
    warnings_of,
    with_model,
    write_colmap,
    write_transforms,
)

PATCH = np.s_[20:40, 30:60]


def mask_of(shot: Shot) -> np.ndarray:
    """(H, W, 3): black where `PATCH` is."""
    mask = np.full((shot.camera.height, shot.camera.width, 3), 255, np.uint8)
    mask[PATCH] = 0
    return mask


def read(folder: Path, max_size: int | None = None) -> Capture:
    return read_capture(folder, max_size=max_size)


@pytest.mark.parametrize("name", ["0001.png.png", "0001.png", "0001.png.bmp", "0001.tif"])
def test_a_mask_beside_the_photographs_is_found_under_both_its_names(tmp_path: Path, name: str) -> None:
    photographs = shots(3)
    save(write_colmap(tmp_path, photographs) / "masks" / name, mask_of(photographs[0]))
    capture = read(tmp_path)
    first, *others = capture.views
    assert first.mask is not None
    assert not first.mask[PATCH].any()
    assert first.mask.sum() == first.mask.size - 20 * 30
    assert all(view.mask is None for view in others)
    assert first.alpha is None
    assert warnings_of(capture) == ["masks", "few-views"]
    assert "1 of 3 photographs have masks, which leave out 2.9%" in capture.warnings[0].message


def test_a_mask_may_be_a_jpeg(tmp_path: Path) -> None:
    photographs = shots(3)
    (write_colmap(tmp_path, photographs) / "masks").mkdir()
    Image.fromarray(mask_of(photographs[0])).save(tmp_path / "masks" / "0001.jpg", quality=50)
    mask = read(tmp_path).views[0].mask
    assert mask is not None
    assert np.array_equal(mask, mask_of(photographs[0])[..., 0] > 0)


def test_a_mask_lies_in_the_folder_of_its_photograph(tmp_path: Path) -> None:
    photographs = shots(3, pattern="camera/{:04d}.png")
    write_colmap(tmp_path, photographs)
    save(tmp_path / "masks" / "camera" / "0002.png.png", mask_of(photographs[0]))
    assert [view.mask is not None for view in read(tmp_path).views] == [False, True, False]


def test_a_camera_file_names_masks(tmp_path: Path) -> None:
    photographs = shots(3)
    listed = frames(photographs)
    listed[1]["mask_path"] = "parts/second.png"
    save(tmp_path / "parts" / "second.png", mask_of(photographs[1]))
    write_transforms(tmp_path, photographs, {**intrinsics(pinhole()), "frames": listed})
    assert [view.mask is not None for view in read(tmp_path).views] == [False, True, False]


def test_a_capture_is_written_with_its_masks(tmp_path: Path) -> None:
    photographs = shots(3)
    save(write_colmap(tmp_path / "given", photographs) / "masks" / "0001.png", mask_of(photographs[0]))
    given = read(tmp_path / "given")
    write_capture(given, tmp_path / "written")
    for view, again in zip(given.views, read(tmp_path / "written").views, strict=True):
        assert np.array_equal(view.mask, again.mask) if view.mask is not None else again.mask is None


@pytest.mark.parametrize(
    "camera", [pinhole(), with_model("OPENCV", [-0.2, 0.05, 0.01, -0.01]), with_model("OPENCV_FISHEYE", [0.02])]
)
@pytest.mark.parametrize("max_size", [None, 60])
def test_no_color_of_what_is_masked_is_left_anywhere(tmp_path: Path, camera, max_size: int | None) -> None:
    photographs = shots(2, camera)
    save_images(write_colmap(tmp_path / "clean", photographs) / "images", photographs)
    write_colmap(tmp_path / "painted", photographs)
    for shot in photographs:
        painted = shot.render()
        painted[PATCH] = 255
        save(tmp_path / "painted" / "images" / shot.name, painted)
        save(tmp_path / "painted" / "masks" / shot.name, mask_of(shot))
    for clean, painted_view in zip(
        read(tmp_path / "clean", max_size).views, read(tmp_path / "painted", max_size).views, strict=True
    ):
        mask = painted_view.mask
        assert mask is not None
        # Resampling's kernel reaches two pixels further than a mask, with a small weight.
        difference = np.abs(clean.image.astype(int) - painted_view.image)[mask].max(axis=-1)
        assert (difference > 30).sum() == 0
        assert 0.05 < (~mask).mean() < 0.16


@pytest.mark.parametrize("scale", [1, 2])
def test_a_mask_may_be_smaller_than_its_photograph(tmp_path: Path, scale: int) -> None:
    photographs = shots(2)
    write_colmap(tmp_path, photographs)
    save(tmp_path / "masks" / "0001.png", mask_of(photographs[0])[::scale, ::scale])
    mask = read(tmp_path).views[0].mask
    assert mask is not None
    assert np.array_equal(mask, mask_of(photographs[0])[..., 0] > 0)


def test_a_mask_is_turned_with_its_photograph(tmp_path: Path) -> None:
    photographs = shots(2)
    listed = {"frames": frames(photographs), "fl_x": 80.0}
    write_transforms(tmp_path / "stored", photographs, listed, images=False)
    write_transforms(tmp_path / "upright", photographs, listed, images=False)
    for shot in photographs:
        for folder in ("stored", "upright"):
            save(tmp_path / folder / "images" / shot.name.replace("png", "jpg"), shot.render(), Orientation=6)
        mask = mask_of(shot)
        save(tmp_path / "stored" / "masks" / shot.name, mask)
        save(tmp_path / "upright" / "masks" / shot.name, np.rot90(mask, -1))
    for folder in ("stored", "upright"):
        (tmp_path / folder / "transforms.json").write_text(
            (tmp_path / folder / "transforms.json").read_text().replace(".png", ".jpg")
        )
        mask = read(tmp_path / folder).views[0].mask
        assert mask is not None
        assert np.array_equal(mask, np.rot90(mask_of(photographs[0])[..., 0] > 0, -1)), folder


def test_a_photograph_that_is_masked_completely_is_left_out(tmp_path: Path) -> None:
    photographs = shots(3)
    save(write_colmap(tmp_path, photographs) / "masks" / "0002.png", np.zeros((72, 96, 3), np.uint8))
    capture = read(tmp_path)
    assert [view.key for view in capture.views] == ["0001", "0003"]
    assert "masked-completely" in warnings_of(capture)


def test_a_white_mask_is_none(tmp_path: Path) -> None:
    photographs = shots(3)
    save(write_colmap(tmp_path, photographs) / "masks" / "0002.png", np.full((72, 96, 1), 255, np.uint8))
    assert all(view.mask is None for view in read(tmp_path).views)


def test_masks_of_no_photograph_are_named(tmp_path: Path) -> None:
    photographs = shots(3)
    save(write_colmap(tmp_path, photographs) / "masks" / "other.png", mask_of(photographs[0]))
    for capture in (read(tmp_path), inspect_capture(tmp_path)):
        (message,) = [warning.message for warning in capture.warnings if warning.name == "masks-unused"]
        assert "1 masks belong to no photograph and are not used: other.png" in message


def test_masks_of_another_type_are_named(tmp_path: Path) -> None:
    photographs = shots(3)
    save(write_colmap(tmp_path, photographs) / "masks" / "0001.tga", mask_of(photographs[0]))
    (message,) = [warning.message for warning in read(tmp_path).warnings if warning.name == "masks-unused"]
    assert "not used: 0001.tga" in message


@pytest.mark.parametrize("name", ["0001.png.png", "0001.jpg"])
def test_masks_in_a_folder_of_another_name_are_named(tmp_path: Path, name: str) -> None:
    photographs = shots(3)
    save(write_colmap(tmp_path, photographs) / "mask" / name, mask_of(photographs[0]))
    capture = read(tmp_path)
    (message,) = [warning.message for warning in capture.warnings if warning.name == "masks-unused"]
    assert message == f"{tmp_path / 'mask'}: the masks in it are not used; call the folder masks"
    (tmp_path / "mask" / name).rename(tmp_path / "mask" / "other.png")
    assert "masks-unused" not in warnings_of(read(tmp_path))


@pytest.mark.parametrize(
    ("name", "way"),
    [("0001.png.mask.png", "a folder masks"), ("dynamic_mask_0001.png", "a folder masks, inverted")],
)
def test_masks_among_the_photographs_are_named_and_not_taken_for_photographs(
    tmp_path: Path, name: str, way: str
) -> None:
    photographs = shots(3)
    save(write_colmap(tmp_path, photographs) / "images" / name, mask_of(photographs[0]))
    for capture in (read(tmp_path), inspect_capture(tmp_path)):
        assert "unregistered" not in warnings_of(capture)
        (message,) = [warning.message for warning in capture.warnings if warning.name == "masks-unused"]
        assert f"1 masks among the photographs are not used: {name}; put them into {way}, as 1.png for 1.jpg" in message


def test_photographs_of_a_mask_are_not_masks(tmp_path: Path) -> None:
    photographs = shots(3)
    for name in ("mask", "masks"):
        save_images(tmp_path / name / name, photographs)
        listed = {**intrinsics(pinhole()), "frames": frames(photographs, f"{name}/")}
        capture = read(write_transforms(tmp_path / name, photographs, listed, images=False))
        assert all(view.mask is None for view in capture.views)
        assert warnings_of(capture) == ["few-views", "no-points"]


def black(shape: tuple[int, ...], value: int = 0) -> np.ndarray:
    return np.full(shape, value, np.uint8)


@pytest.mark.parametrize(
    ("masks", "message"),
    [
        ({"0001": black((72, 72, 3))}, "the mask is 72 x 72 pixels, its photograph 96 x 72"),
        ({"0001": black((72, 96, 3), 1)}, "the mask has no white, only values up to 1"),
        ({f"000{i}": black((72, 96, 3)) for i in (1, 2, 3)}, "the masks of 3 of 3 photographs leave nothing"),
    ],
)
def test_masks_that_cannot_be_meant_are_refused(tmp_path: Path, masks: dict[str, np.ndarray], message: str) -> None:
    write_colmap(tmp_path, shots(3))
    for name, pixels in masks.items():
        save(tmp_path / "masks" / f"{name}.png", pixels)
    with pytest.raises(InputError, match=message):
        read(tmp_path)


def test_a_damaged_mask_is_refused(tmp_path: Path) -> None:
    photographs = shots(3)
    mask = save(write_colmap(tmp_path, photographs) / "masks" / "0001.png", mask_of(photographs[0]))
    mask.write_bytes(b"")
    with pytest.raises(InputError, match=r"masks/0001.png"):
        read(tmp_path)


def test_a_mask_that_leads_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    photographs = shots(3)
    outside = save(tmp_path / "outside.png", mask_of(photographs[0]))
    folder = write_colmap(tmp_path / "capture", photographs) / "masks"
    folder.mkdir()
    (folder / "0001.png").symlink_to(outside)
    with pytest.raises(InputError, match="leads out of"):
        read(tmp_path / "capture")


def test_a_camera_file_cannot_name_a_mask_elsewhere(tmp_path: Path) -> None:
    photographs = shots(3)
    save(tmp_path / "outside.png", mask_of(photographs[0]))
    listed = frames(photographs)
    listed[0]["mask_path"] = "../outside.png"
    write_transforms(tmp_path / "capture", photographs, {**intrinsics(pinhole()), "frames": listed})
    with pytest.raises(InputError, match="leads out of the capture folder"):
        read(tmp_path / "capture")


def test_no_feature_is_sought_in_what_is_masked_or_transparent(tmp_path: Path) -> None:
    (shot,) = shots(1)
    alpha = np.full((72, 96, 1), 255, np.uint8)
    alpha[:10] = 0
    save(tmp_path / "given" / shot.name, np.dstack([shot.render(), alpha]))
    mask = save(tmp_path / "mask.png", mask_of(shot))
    (tmp_path / "work").mkdir()
    job = SfmJob(
        str(tmp_path / "given"), [shot.name], [0], str(tmp_path / "work"), SfmSettings(), {shot.name: str(mask)}
    )
    copy_photographs(SfmJob.from_json(job.to_json()), lambda _: None)
    from PIL import Image

    sought = np.asarray(Image.open(tmp_path / "work" / MASKS / f"{copy_name(0)}.png"))[..., 0] > 0
    expected = mask_of(shot)[..., 0] > 0
    expected[:10] = False
    assert np.array_equal(sought, expected)


def test_photographs_in_the_folder_itself_are_not_their_masks(tmp_path: Path) -> None:
    save_images(tmp_path, shots(3))
    save_images(tmp_path / "masks", shots(3))
    assert inspect_capture(tmp_path).views == 3


def test_a_smaller_mask_leaves_out_every_pixel_that_shows_something_masked() -> None:
    mask = np.full((8, 8), 255, np.uint8)
    mask[3, 3] = 0
    smaller = resized_mask(mask, 4, 4)
    assert smaller[1, 1] == 0
    assert (smaller == 0).sum() == 1
