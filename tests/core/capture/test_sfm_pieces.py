"""Pieces of a reconstruction that share photographs, or matches alone, are joined; those that do not stay apart."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from cvdgs.core.capture.sfm_pieces import join_pieces

PHOTOGRAPHS, LARGER = 14, 9
TURN = np.array([0.3, -0.2, 0.5, 0.8])
ELSEWHERE = pycolmap.Sim3d(2.5, pycolmap.Rotation3d(TURN / np.linalg.norm(TURN)), np.array([3.0, 1.0, -2.0]))


@pytest.fixture(autouse=True)
def quiet() -> Iterator[None]:
    """pycolmap misses the pictures of photographs that are made of numbers."""
    level, pycolmap.logging.minloglevel = pycolmap.logging.minloglevel, int(pycolmap.logging.Level.FATAL.value)
    yield
    pycolmap.logging.minloglevel = level


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, pycolmap.Reconstruction]:
    """A database of features and matches, and where everything is."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_frames_per_rig, options.num_points3D = 1, PHOTOGRAPHS, 300
    options.two_view_geometry_has_relative_pose = True
    database = tmp_path_factory.mktemp("pieces") / "database.db"
    pycolmap.set_random_seed(0)
    with pycolmap.Database.open(str(database)) as opened:
        return database, pycolmap.synthesize_dataset(options, opened)


def piece(truth: pycolmap.Reconstruction, images: list[int]) -> pycolmap.Reconstruction:
    """The photographs `images` alone, with their points."""
    model = pycolmap.Reconstruction(truth)
    observations = pycolmap.ObservationManager(model)
    for image in list(model.reg_image_ids()):
        if image not in images:
            observations.deregister_frame(model.image(image).frame_id)
    return model


@pytest.mark.parametrize("shared", [2, 0])
@pytest.mark.parametrize("through_a_file", [False, True])  # which drops photographs without a place
def test_pieces_of_one_place_are_joined_whatever_the_scale_and_side_of_each(
    world: tuple[Path, pycolmap.Reconstruction], tmp_path: Path, shared: int, through_a_file: bool
) -> None:
    database, truth = world
    images = sorted(truth.reg_image_ids())
    larger, smaller = piece(truth, images[:LARGER]), piece(truth, images[LARGER - shared :])
    smaller.transform(ELSEWHERE)
    (tmp_path / "images").mkdir()
    if through_a_file:
        larger.write_binary(str(tmp_path / "images"))
        larger = pycolmap.Reconstruction(str(tmp_path / "images"))
    for round_ in range(2):
        joined = join_pieces([smaller, larger], database, tmp_path / "images", tmp_path / f"work-{round_}", 0)
        assert joined is not None
        assert sorted(joined.reg_image_ids()) == images
        assert joined.num_points3D() == truth.num_points3D()
        for image in images:
            own, true = joined.image(image).projection_center(), truth.image(image).projection_center()
            assert own == pytest.approx(true, abs=1e-6)
    assert larger.num_reg_images() == LARGER
    assert smaller.num_reg_images() == PHOTOGRAPHS - LARGER + shared


def test_pieces_with_nothing_in_common_or_that_contradict_each_other_stay_apart(
    world: tuple[Path, pycolmap.Reconstruction], tmp_path: Path
) -> None:
    database, truth = world
    images = sorted(truth.reg_image_ids())
    larger, smaller = piece(truth, images[:LARGER]), piece(truth, images[LARGER:])
    bare = tmp_path / "bare.db"
    pycolmap.Database.open(str(bare)).close()
    assert join_pieces([larger, smaller], bare, tmp_path, tmp_path / "work", 0) is None
    rng = np.random.default_rng(0)
    for point in smaller.points3D.values():
        point.xyz = rng.normal(size=3)
    assert join_pieces([larger, smaller], database, tmp_path, tmp_path / "work", 0) is None
    assert join_pieces([larger], database, tmp_path, tmp_path / "work", 0) is None
