"""Gaussians in files of any format: the same scene comes out, and what is damaged is refused in one line."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.errors import InputError
from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.io.files import read_gaussians, write_gaussians
from cvdgs.core.splats.io.ply import write_ply
from cvdgs.core.splats.io.splat_file import read_splat, write_splat

SCRIPT = ROOT / "scripts" / "convert.py"
EXAMPLES = ROOT.parent / "shared" / "data" / "splats" / "metalsplatter_mit"
examples = pytest.mark.skipif(not EXAMPLES.is_dir(), reason="the evaluation data is not here")


def cloud(count: int, degree: int = 0, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)
    return Gaussians(
        means=rng.standard_normal((count, 3)).astype(np.float32),
        log_scales=rng.uniform(-8.0, 1.0, (count, 3)).astype(np.float32),
        quaternions=rng.standard_normal((count, 4)).astype(np.float32),
        opacity_logits=rng.uniform(-5.0, 5.0, count).astype(np.float32),
        sh=rng.uniform(-0.8, 0.8, (count, (degree + 1) ** 2, 3)).astype(np.float32),
    )


def rotations_differ_by(a: Gaussians, b: Gaussians) -> float:
    """Largest angle in degrees."""
    first, second = (x.quaternions / np.linalg.norm(x.quaternions, axis=1, keepdims=True) for x in (a, b))
    return float(np.degrees(2.0 * np.arccos(np.clip(np.abs((first * second).sum(axis=1)), 0.0, 1.0))).max(initial=0.0))


@given(count=st.integers(0, 20), seed=st.integers(0, 1000))
@settings(deadline=None, max_examples=30)
def test_a_splat_file_rounds_to_bytes_and_no_further(tmp_path_factory, count, seed):
    path = tmp_path_factory.mktemp("splat") / "s.splat"
    original = cloud(count, seed=seed)
    write_splat(path, original)
    assert path.stat().st_size == 32 * count
    result = read_splat(path)
    np.testing.assert_array_equal(result.means, original.means)
    np.testing.assert_allclose(result.log_scales, original.log_scales, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(result.opacities, original.opacities, atol=0.51 / 255)
    np.testing.assert_allclose(result.base_colors, np.clip(original.base_colors, 0.0, 1.0), atol=0.51 / 255)
    assert rotations_differ_by(result, original) < 1.5
    write_splat(path, result)
    np.testing.assert_array_equal(read_splat(path).sh, result.sh)


def test_ends_of_the_range_survive_a_splat_file(tmp_path):
    original = cloud(2)
    original.log_scales[:] = ((-np.inf,) * 3, (100.0,) * 3)
    original.opacity_logits[:] = (-200.0, 200.0)
    original.quaternions[:] = ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0))
    write_splat(tmp_path / "s.splat", original)
    result = read_gaussians(tmp_path / "s.splat")
    assert np.exp(result.log_scales[0]).max() <= 1e-19
    np.testing.assert_allclose(result.log_scales[1], 88.0, rtol=1e-6)
    np.testing.assert_allclose(result.opacities, [0.0, 1.0], atol=0.002)
    np.testing.assert_allclose(result.quaternions[0], [1.0, 0.0, 0.0, 0.0], atol=0.01)


@examples
@pytest.mark.parametrize("suffix", [".spz", ".splat"])
def test_another_tools_files_of_one_scene_agree(suffix):
    scene, other = (read_gaussians(EXAMPLES / f"test-splat.3-points-from-train{s}") for s in (".ply", suffix))
    np.testing.assert_allclose(other.means, scene.means, atol=2e-4)
    np.testing.assert_allclose(other.log_scales, scene.log_scales, atol=1 / 32)
    np.testing.assert_allclose(other.opacities, scene.opacities, atol=0.01)
    np.testing.assert_allclose(other.base_colors, np.clip(scene.base_colors, 0.0, 1.0), atol=0.01)
    assert rotations_differ_by(other, scene) < 1.5
    if other.sh_degree:
        np.testing.assert_allclose(other.sh[:, 1:], scene.sh[:, 1:], atol=0.07)


@examples
@pytest.mark.parametrize("name", ["beetle.ascii.ply", "beetle.binary.ply"])
def test_a_mesh_is_refused_for_being_one(name):
    with pytest.raises(InputError, match="a mesh or point cloud, not Gaussians"):
        read_gaussians(EXAMPLES / name)


def test_content_and_not_the_ending_decides_how_a_file_is_read(tmp_path):
    original = cloud(5, degree=1)
    write_ply(tmp_path / "really.splat", original)
    np.testing.assert_array_equal(read_gaussians(tmp_path / "really.splat").sh, original.sh)


@pytest.mark.parametrize("suffix", [".ply", ".spz", ".splat", ".glb", ".SPZ"])
def test_the_ending_decides_what_is_written(tmp_path, suffix):
    original = cloud(5)
    write_gaussians(tmp_path / f"s{suffix}", original)
    np.testing.assert_allclose(read_gaussians(tmp_path / f"s{suffix}").means, original.means, atol=1e-4)
    assert [path.name for path in tmp_path.iterdir()] == [f"s{suffix}"]


def test_an_unknown_ending_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(InputError, match=r"\.ply, \.spz, \.splat"):
        write_gaussians(tmp_path / "s.obj", cloud(1))
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        write_gaussians(tmp_path / "nowhere" / "s.ply", cloud(1))


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.splat", bytes(33), "33 bytes are not a multiple of 32"),
        ("a.png", b"\x89PNG\r\n", "not a file of Gaussians"),
        ("a.spz", b"ply", "header never ends"),
        ("a.png", b"\x89PNG\r\n", "choose one of .*, or export a plain PLY"),
        ("a.ply", b"", "the file is empty"),
        ("a.splat", b"", "the file is empty"),
        ("a.sog", b"PK\3\4", "SOG .* - export a plain PLY"),
        ("a.KSPLAT", bytes(4096), "KSPLAT .* - export a plain PLY"),
        ("a.usda", b"#usda 1.0\n", "USD cannot be read - export a plain PLY"),
        ("a.gltf", b"{}", "glTF .* - export a plain PLY"),
        (
            "a.compressed.ply",
            b"ply\nformat binary_little_endian 1.0\nelement chunk 1\nproperty float min_x\nend_header\n",
            "compressed PLY .* - export a plain PLY",
        ),
    ],
)
def test_other_files_are_refused_in_one_line(tmp_path, name, content, said):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=said) as caught:
        read_gaussians(tmp_path / name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("field", ["means", "log_scales", "quaternions", "opacity_logits", "sh"])
def test_values_that_are_no_numbers_are_refused_or_left_out(tmp_path, field):
    damaged = cloud(1000)
    getattr(damaged, field).reshape(1000, -1)[7, 0] = np.nan
    write_ply(tmp_path / "s.ply", damaged)
    with pytest.raises(InputError, match="1 of 1,000 Gaussians"):
        read_gaussians(tmp_path / "s.ply")
    kept = read_gaussians(tmp_path / "s.ply", drop_damaged=True)
    np.testing.assert_array_equal(kept.means, np.delete(damaged.means, 7, axis=0))


def test_a_file_without_a_sound_gaussian_is_refused(tmp_path):
    damaged = cloud(3)
    damaged.means[:] = np.nan
    write_ply(tmp_path / "s.ply", damaged)
    with pytest.raises(InputError, match="every Gaussian has values that are not finite numbers - export it again"):
        read_gaussians(tmp_path / "s.ply", drop_damaged=True)


def test_infinite_opacity_logits_become_opaque(tmp_path):
    original = cloud(3)
    original.opacity_logits[:] = (np.inf, -np.inf, 0.5)
    write_ply(tmp_path / "s.ply", original)
    result = read_gaussians(tmp_path / "s.ply")
    assert np.isfinite(result.opacity_logits).all()
    np.testing.assert_allclose(result.opacities, [1.0, 0.0, 0.62245935], atol=1e-6)


@pytest.mark.parametrize("suffix", [".ply", ".splat"])
def test_a_rotation_of_length_zero_becomes_none(tmp_path, suffix):
    original = cloud(3)
    write_gaussians(path := tmp_path / f"s{suffix}", original)
    data = bytearray(path.read_bytes())
    if suffix == ".ply":
        data[-16:] = bytes(16)  # rot_0 to rot_3 stand last
    else:
        data[-4:] = bytes([128] * 4)
    path.write_bytes(data)
    result = read_gaussians(path)
    np.testing.assert_array_equal(result.quaternions[2], [1, 0, 0, 0])
    assert not np.array_equal(result.quaternions[1], [1, 0, 0, 0])


def test_flat_gaussians_are_not_called_a_mesh(tmp_path):
    write_ply(path := tmp_path / "flat.ply", cloud(2))
    path.write_bytes(path.read_bytes().replace(b"property float scale_2", b"property float thickness"))
    with pytest.raises(InputError, match=r"Gaussians of another kind \(no scale_2\)"):
        read_gaussians(path)


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, SCRIPT, *arguments], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
def test_a_name_that_the_console_cannot_show_is_written_and_told(tmp_path, monkeypatch, encoding):
    monkeypatch.setenv("PYTHONIOENCODING", encoding)
    write_ply(tmp_path / "織物.ply", cloud(2))
    done = run(tmp_path / "織物.ply", tmp_path / "織物.splat")
    assert (done.returncode, done.stderr) == (0, "")
    assert "\\u7e54\\u7269.splat: 2 Gaussians" in done.stdout


def test_the_script_converts_and_says_what_is_lost(tmp_path):
    original = cloud(50, degree=2)
    write_ply(tmp_path / "a.ply", original)
    done = run(tmp_path / "a.ply", tmp_path / "b.splat")
    assert done.returncode == 0
    assert "50 Gaussians" in done.stdout
    assert "degree 2" in done.stdout
    np.testing.assert_array_equal(read_splat(tmp_path / "b.splat").means, original.means)


def test_the_script_complains_in_one_line_and_leaves_everything_as_it_is(tmp_path):
    damaged = cloud(3)
    damaged.means[0] = np.nan
    write_ply(tmp_path / "a.ply", damaged)
    (tmp_path / "b.ply").write_bytes(b"earlier")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for arguments, said in (
        ((tmp_path / "a.ply", tmp_path / "a.ply"), "is also the input"),
        ((tmp_path / "a.ply", tmp_path / "b.ply"), "--drop-damaged"),
        ((tmp_path / "a.ply", tmp_path / "b.txt"), "not a format for Gaussians"),
        (
            (tmp_path / "a.ply", tmp_path / f"{'b' * 300}.ply", "--drop-damaged"),
            "cannot be written (File name too long)",
        ),
        ((tmp_path / f"{'a' * 300}.ply", tmp_path / "b.ply"), "cannot be read (File name too long)"),
        ((tmp_path / "a.ply",), "see --help"),
    ):
        done = run(*arguments)
        assert done.returncode == 2
        assert said in done.stderr
        assert done.stderr.count("\n") == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    assert run(tmp_path / "a.ply", tmp_path / "b.ply", "--drop-damaged").returncode == 0
    assert len(read_gaussians(tmp_path / "b.ply")) == 2


def test_recorded_scores_count_for_what_is_left_of_a_damaged_file(tmp_path):
    original, scores = cloud(50), np.zeros(50, np.float32)
    original.means[3], scores[10:] = np.nan, 1.0
    write_ply(tmp_path / "really.splat", original, scores)
    done = run(tmp_path / "really.splat", tmp_path / "b.ply", "--drop-damaged", "--clean", "0.5")
    assert (done.returncode, done.stderr) == (0, "")
    assert "40 floaters" in done.stdout
    np.testing.assert_array_equal(read_gaussians(tmp_path / "b.ply").means, np.delete(original.means[:10], 3, axis=0))


def test_a_file_with_the_ending_of_another_format_is_cleaned(tmp_path):
    write_gaussians(tmp_path / "a.spz", cloud(50))
    (tmp_path / "a.spz").rename(tmp_path / "a.ply")
    done = run(tmp_path / "a.ply", tmp_path / "b.ply", "--clean", "0.5")
    assert (done.returncode, done.stderr) == (0, "")
