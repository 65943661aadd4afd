"""PLY files: what we write others read, what others write we read, and what is not Gaussians is refused."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plyfile import PlyData, PlyElement

from cvdgs.core.errors import InputError
from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.ply import read_ply, write_ply


def random_gaussians(count: int, degree: int, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)
    shapes = ((count, 3), (count, 3), (count, 4), (count,), (count, (degree + 1) ** 2, 3))
    return Gaussians(*(rng.standard_normal(shape).astype(np.float32) for shape in shapes))


@given(count=st.integers(0, 20), degree=st.integers(0, 3), seed=st.integers(0, 1000))
@settings(deadline=None, max_examples=30)
def test_what_is_written_is_read_back_bit_by_bit(tmp_path_factory, count, degree, seed):
    path = tmp_path_factory.mktemp("ply") / "splats.ply"
    original = random_gaussians(count, degree, seed)
    write_ply(path, original)
    result = read_ply(path)
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(result, name), getattr(original, name))


def test_an_independent_reader_finds_the_standard_properties(tmp_path):
    original = random_gaussians(5, 1)
    write_ply(tmp_path / "s.ply", original)
    vertex = PlyData.read(str(tmp_path / "s.ply"))["vertex"]
    np.testing.assert_array_equal(vertex["x"], original.means[:, 0])
    np.testing.assert_array_equal(vertex["rot_0"], original.quaternions[:, 0])
    np.testing.assert_array_equal(vertex["f_dc_2"], original.sh[:, 0, 2])
    # channel-major: the three first-degree terms of red come before green's
    np.testing.assert_array_equal(vertex["f_rest_1"], original.sh[:, 2, 0])
    np.testing.assert_array_equal(vertex["f_rest_3"], original.sh[:, 1, 1])


def test_files_of_other_tools_are_read_whatever_the_order_and_type(tmp_path):
    names = ["opacity", "rot_3", "rot_2", "rot_1", "rot_0", "scale_0", "scale_1", "scale_2",
             "f_dc_0", "f_dc_1", "f_dc_2", "z", "y", "x"]  # fmt: skip
    table = np.zeros(3, [(name, "f8") for name in names])
    for i, name in enumerate(names):
        table[name] = i + np.arange(3) / 10
    PlyData([PlyElement.describe(table, "vertex")], byte_order="<").write(str(tmp_path / "other.ply"))
    result = read_ply(tmp_path / "other.ply")
    assert result.sh_degree == 0
    np.testing.assert_allclose(result.means[1], [13.1, 12.1, 11.1], rtol=1e-6)
    np.testing.assert_allclose(result.quaternions[2], [4.2, 3.2, 2.2, 1.2], rtol=1e-6)


def test_a_file_that_is_cut_short_says_how_much_is_missing(tmp_path):
    write_ply(tmp_path / "s.ply", random_gaussians(10, 0))
    data = (tmp_path / "s.ply").read_bytes()
    (tmp_path / "s.ply").write_bytes(data[:-100])
    with pytest.raises(InputError, match="2 of 10"):
        read_ply(tmp_path / "s.ply")


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"PNG not a ply",
        b"ply\n",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nend_header\n"
        + struct.pack("<3f", 1, 2, 3),
        b"ply\nformat ascii 1.0\nelement vertex 1000000000000\nproperty float x\nend_header\n",
        b"ply\nformat binary_little_endian 1.0\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n",
        b"ply\n" + b"comment long\n" * 10000,
    ],
    ids=["empty", "no-ply", "no-header", "mesh", "huge-count", "faces-first", "endless-header"],
)
def test_what_is_not_gaussians_is_refused_in_one_line(tmp_path, content):
    (tmp_path / "bad.ply").write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_ply(tmp_path / "bad.ply")
    assert "bad.ply" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_ply(tmp_path / "nothing.ply")


def test_writing_leaves_no_other_file_behind(tmp_path):
    write_ply(tmp_path / "s.ply", random_gaussians(2, 0))
    assert [p.name for p in tmp_path.iterdir()] == ["s.ply"]
