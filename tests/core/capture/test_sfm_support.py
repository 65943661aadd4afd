"""What matches say of a reconstruction, and photographs placed anew by them, on scenes that are known exactly."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from cvdgs.core.capture.sfm_job import SfmSettings
from cvdgs.core.capture.sfm_mapping import Mapped, _better, _placed_anew
from cvdgs.core.capture.sfm_support import Support, read_matches, support_of


@pytest.fixture
def scene(tmp_path: Path) -> tuple[Path, pycolmap.Reconstruction]:
    """A database of features and matches of ten photographs by one camera, and where they were really taken from."""
    pycolmap.set_random_seed(1)
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_frames_per_rig, options.num_points3D = 1, 10, 200
    options.two_view_geometry_has_relative_pose = True
    file = tmp_path / "database.db"
    with pycolmap.Database.open(str(file)) as database:
        truth = pycolmap.synthesize_dataset(options, database)
    return file, truth


def moved(model: pycolmap.Reconstruction, images: list[int], offset: tuple[float, float, float]) -> None:
    for image in images:
        frame = model.image(image).frame
        pose = frame.rig_from_world
        frame.rig_from_world = pycolmap.Rigid3d(pose.rotation, pose.translation + np.array(offset))


def test_all_matches_fit_the_truth(scene) -> None:
    file, truth = scene
    support = support_of(truth, read_matches(file))
    assert support.cost < 1e-6
    assert min(support.shares.values()) == 1.0


def test_matches_contradict_a_photograph_in_a_wrong_place_most_of_all(scene) -> None:
    file, truth = scene
    matches = read_matches(file)
    moved(truth, [3], (0.3, 0.0, 0.0))
    support = support_of(truth, matches)
    assert support.shares[3] < 0.5
    assert min(share for image, share in support.shares.items() if image != 3) > 0.8
    assert support.cost > 0.01


def test_a_photograph_without_a_place_costs_its_matches_and_blames_no_other(scene) -> None:
    file, truth = scene
    pycolmap.ObservationManager(truth).deregister_frame(truth.image(3).frame_id)
    support = support_of(truth, read_matches(file))
    assert support.cost == pytest.approx(9 / 45)  # of the pairs among ten, all with the same matches
    assert 3 not in support.shares
    assert min(support.shares.values()) == 1.0


def test_points_that_two_photographs_alone_show_judge_where_there_are_enough(tmp_path: Path) -> None:
    camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_PINHOLE", 500.0, 640, 480)
    keypoints = np.random.default_rng(0).uniform(0.0, 480.0, (300, 2)).astype(np.float32)
    found = {}
    for seen_thrice in (50, 150):
        with pycolmap.Database.open(str(tmp_path / f"{seen_thrice}.db")) as database:
            database.write_camera(camera, use_camera_id=True)
            for image in (1, 2, 3):
                database.write_image(pycolmap.Image(f"{image}.png", camera_id=1, image_id=image), use_image_id=True)
                database.write_keypoints(image, keypoints)
            for pair, count in (((1, 2), 300), ((2, 3), seen_thrice)):
                geometry = pycolmap.TwoViewGeometry()
                geometry.inlier_matches = np.repeat(np.arange(count, dtype=np.uint32)[:, None], 2, axis=1)
                database.write_two_view_geometry(*pair, geometry)
        found[seen_thrice] = read_matches(tmp_path / f"{seen_thrice}.db")
    np.testing.assert_array_equal(found[50].judges[1, 2][:, 0], keypoints[50:])
    assert len(found[50].judges[2, 3]) == 0
    assert len(found[50].every[1, 2]) == 300
    assert found[150].judges is found[150].every  # 150 alone are too few


def test_photographs_in_wrong_places_are_placed_anew_by_their_matches(scene, tmp_path: Path) -> None:
    file, truth = scene
    matches, wrong = read_matches(file), pycolmap.Reconstruction(truth)
    moved(wrong, [3, 7], (0.05, 0.0, 0.0))
    found = Mapped(wrong, [10], "global", support_of(wrong, matches))
    assert found.is_bent
    again = _placed_anew(found, file, tmp_path, tmp_path / "again", matches, SfmSettings())
    assert again is not None
    assert again.placed == 10
    assert min(again.support.shares.values()) > 0.99
    to_truth = pycolmap.align_reconstructions_via_proj_centers(again.model, truth, 0.1)
    assert to_truth is not None
    for image in (3, 7):
        place = to_truth * again.model.image(image).projection_center()
        assert np.linalg.norm(place - truth.image(image).projection_center()) < 1e-3


def test_photographs_without_a_place_get_one_by_their_matches(scene, tmp_path: Path) -> None:
    file, truth = scene
    matches, few = read_matches(file), pycolmap.Reconstruction(truth)
    for image in (3, 7):
        pycolmap.ObservationManager(few).deregister_frame(few.image(image).frame_id)
    found = Mapped(few, [8, 2], "incremental", support_of(few, matches))
    again = _placed_anew(found, file, tmp_path, tmp_path / "again", matches, SfmSettings())
    assert again is not None
    assert again.placed == 10
    assert min(again.support.shares.values()) > 0.99


def test_what_explains_more_is_better_but_never_with_too_few_photographs(scene) -> None:
    _, truth = scene
    few = pycolmap.Reconstruction(truth)
    pycolmap.ObservationManager(few).deregister_frame(few.image(3).frame_id)
    whole = Mapped(truth, [10], "global", Support(0.2, {}))
    lacking = Mapped(few, [9], "incremental", Support(0.1, {}))
    assert _better(whole, lacking, enough=9.0) is lacking
    assert _better(whole, lacking, enough=9.5) is whole
    assert _better(None, lacking, enough=9.5) is lacking
    assert _better(None, None, enough=9.5) is None
