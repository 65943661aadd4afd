"""USD files: the geometry once and a variant for each observer, as OpenUSD's own library reads and validates them."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.splats.io.files import write_gaussians, write_layers
from cvdgs.core.splats.io.usd import GAUSSIANS, SCENE, SUFFIXES, VARIANT_SET

from .test_splat_files import cloud


def test_without_the_library_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(InputError, match=r"'usd-core' .* - install the extra 'usd'") as caught:
        write_gaussians(tmp_path / "s.usda", cloud(3))
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def written(path, layers, up="", **options):
    """A stage with `layers`, read again."""
    usd = pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
    write_layers(path, layers, up=up, **options)
    return usd.Stage.Open(str(path))


def run_layers(degree=2):
    first = cloud(20, degree)
    return {"original": first, "deutan-0.5": replace(first, sh=cloud(20, 0, seed=1).sh)}


def observers(stage):
    return stage.GetPrimAtPath(SCENE).GetVariantSets().GetVariantSet(VARIANT_SET)


def values(stage, name):
    return np.array(stage.GetPrimAtPath(GAUSSIANS).GetAttribute(name).Get())


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_stage_holds_the_gaussians_and_a_variant_for_each_layer(tmp_path, suffix):
    layers = run_layers()
    stage = written(tmp_path / f"s{suffix}", layers)
    first = layers["original"]
    assert stage.GetPrimAtPath(GAUSSIANS).GetTypeName() == "ParticleField3DGaussianSplat"
    np.testing.assert_array_equal(values(stage, "positions"), first.means)
    np.testing.assert_allclose(values(stage, "scales"), np.exp(first.log_scales), rtol=1e-6)
    np.testing.assert_allclose(values(stage, "opacities"), first.opacities, rtol=1e-6)
    unit = first.quaternions / np.linalg.norm(first.quaternions, axis=1, keepdims=True)
    stored = stage.GetPrimAtPath(GAUSSIANS).GetAttribute("orientations").Get()
    np.testing.assert_allclose([[q.GetReal(), *q.GetImaginary()] for q in stored], unit, atol=1e-6)
    assert observers(stage).GetVariantSelection() == "original"
    assert set(observers(stage).GetVariantNames()) == {"original", "deutan-0_5"}
    for variant, gaussians in zip(("original", "deutan-0_5"), layers.values(), strict=True):
        observers(stage).SetVariantSelection(variant)
        terms = gaussians.sh.shape[1]
        coefficients = values(stage, "radiance:sphericalHarmonicsCoefficients")
        np.testing.assert_array_equal(coefficients.reshape(-1, terms, 3), gaussians.sh)
        assert values(stage, "radiance:sphericalHarmonicsDegree") == gaussians.sh_degree
    assert [path.name for path in tmp_path.iterdir()] == [f"s{suffix}"]


def test_a_stage_passes_the_validators_of_openusd_with_every_variant(tmp_path):
    validation = pytest.importorskip("pxr.UsdValidation", reason="usd-core is not installed")
    stage = written(tmp_path / "s.usda", run_layers(), up="-y")
    registry = validation.ValidationRegistry()
    names = [metadata.name for metadata in registry.GetAllValidatorMetadata()]
    assert "usdGeomValidators:StageMetadataChecker" in names
    context = validation.ValidationContext(registry.GetOrLoadValidatorsByName(names))
    for variant in observers(stage).GetVariantNames():
        observers(stage).SetVariantSelection(variant)
        assert [error.GetMessage() for error in context.Validate(stage)] == []


@pytest.mark.parametrize(
    ("up", "stage_up"), [("", "Y"), ("y", "Y"), ("z", "Z"), ("x", "Y"), ("-x", "Y"), ("-y", "Y"), ("-z", "Y")]
)
def test_the_axis_that_points_up_is_the_stages(tmp_path, up, stage_up):
    stage = written(tmp_path / "s.usda", {"original": cloud(3)}, up)
    geometry = pytest.importorskip("pxr.UsdGeom")
    assert geometry.GetStageUpAxis(stage) == stage_up
    assert geometry.GetStageMetersPerUnit(stage) == 1.0
    pointing = np.eye(3)["xyz".index(up[-1:] or "y")] * (-1.0 if up.startswith("-") else 1.0)
    matrix = geometry.Xformable(stage.GetPrimAtPath(GAUSSIANS)).ComputeLocalToWorldTransform(0.0)
    turned = np.array(matrix.TransformDir(tuple(pointing)))
    np.testing.assert_allclose(turned, np.eye(3)["XYZ".index(stage_up)], atol=1e-6)


def test_the_stage_of_a_measured_scene_says_how_long_its_unit_is(tmp_path):
    stage = written(tmp_path / "s.usda", {"original": cloud(3)}, metres=0.25)
    assert pytest.importorskip("pxr.UsdGeom").GetStageMetersPerUnit(stage) == 0.25


def test_the_extent_holds_three_standard_deviations(tmp_path):
    gaussians = cloud(1)
    gaussians.means[:], gaussians.log_scales[:] = (1.0, 2.0, 3.0), np.log([0.5, 0.1, 0.1])
    low, high = values(written(tmp_path / "s.usda", {"original": gaussians}), "extent")
    np.testing.assert_allclose((low, high), ([-0.5, 0.5, 1.5], [2.5, 3.5, 4.5]), rtol=1e-6)


def test_layers_that_usd_cannot_tell_apart_are_refused(tmp_path):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    gaussians = cloud(2)
    with pytest.raises(InputError, match="USD cannot tell apart"):
        write_layers(tmp_path / "s.usda", {"deutan-0.5": gaussians, "deutan-0_5": gaussians})


def test_no_gaussians_are_not_written(tmp_path):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    with pytest.raises(InputError, match="no Gaussians to write"):
        write_gaussians(tmp_path / "s.usda", cloud(0))
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    with pytest.raises(InputError, match="cannot be written") as caught:
        write_gaussians(tmp_path / "nowhere" / "s.usda", cloud(1))
    assert "\n" not in str(caught.value)


def test_an_earlier_file_is_replaced(tmp_path):
    for count in (3, 5):
        stage = written(tmp_path / "s.usda", {"original": cloud(count)})
        stage.Reload()
        assert len(values(stage, "positions")) == count
