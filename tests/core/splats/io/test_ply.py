"""PLY files: what we write others read, what others write we read, and what is not Gaussians is refused."""

import struct
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plyfile import PlyData, PlyElement

from cvdgs.core.errors import InputError
from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.io.ply import read_ply, write_ply

from ....effort import function_calls

FROMFILE = np.fromfile


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


def test_of_degree_4_what_is_above_degree_3_is_left_out(tmp_path):
    original = random_gaussians(5, 4)
    write_ply(tmp_path / "s.ply", original)
    result = read_ply(tmp_path / "s.ply")
    assert result.sh_degree == 3
    np.testing.assert_array_equal(result.sh, original.sh[:, :16])
    np.testing.assert_array_equal(result.quaternions, original.quaternions)


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


@pytest.mark.parametrize("encoding", [{"byte_order": "<"}, {"byte_order": ">"}, {"text": True}])
def test_files_of_other_tools_are_read_whatever_the_order_and_type(tmp_path, encoding):
    names = ["opacity", "rot_3", "rot_2", "rot_1", "rot_0", "scale_0", "scale_1", "scale_2",
             "f_dc_0", "f_dc_1", "f_dc_2", "z", "y", "x"]  # fmt: skip
    kinds = {"opacity": "f4", "x": "i2"}
    table = np.zeros(3, [("red", "u1"), *((name, kinds.get(name, "f8")) for name in names), ("confidence", "f4")])
    for i, name in enumerate(names):
        table[name] = i + np.arange(3) / 10
    elements = [PlyElement.describe(table, "vertex"), PlyElement.describe(np.zeros(2, [("i", "i4")]), "camera")]
    PlyData(elements, **encoding, comments=["made elsewhere"]).write(str(tmp_path / "other.ply"))
    result = read_ply(tmp_path / "other.ply")
    assert result.sh_degree == 0
    np.testing.assert_allclose(result.means[1], [13, 12.1, 11.1], rtol=1e-6)
    np.testing.assert_allclose(result.quaternions[2], [4.2, 3.2, 2.2, 1.2], rtol=1e-6)


def test_a_file_that_is_cut_short_says_how_much_is_missing(tmp_path):
    write_ply(tmp_path / "s.ply", random_gaussians(10, 0))
    data = (tmp_path / "s.ply").read_bytes()
    (tmp_path / "s.ply").write_bytes(data[:-100])
    with pytest.raises(InputError, match="2 of 10"):
        read_ply(tmp_path / "s.ply")


@given(count=st.integers(0, 20), degree=st.integers(0, 3), block=st.sampled_from([1, 300, 1000]))
@settings(deadline=None, max_examples=20)
def test_the_blocks_of_reading_do_not_show(tmp_path_factory, count, degree, block):
    path = tmp_path_factory.mktemp("ply") / "splats.ply"
    original = random_gaussians(count, degree)
    write_ply(path, original)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cvdgs.core.files.ply._BLOCK", block)
        result = read_ply(path)
    np.testing.assert_array_equal(result.sh, original.sh)
    np.testing.assert_array_equal(result.means, original.means)


def read_as_newer_numpy(*arguments, **options):
    """numpy.fromfile as it is from 2.3 on: where text stops being numbers, it refuses those before as well."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            return FROMFILE(*arguments, **options)
        except DeprecationWarning as warning:
            raise ValueError(str(warning)) from None


@pytest.mark.parametrize("missing", [1, 2, 4])
@pytest.mark.parametrize("newer", [False, True])
def test_a_text_file_that_stops_being_numbers_says_how_much_is_missing(tmp_path, monkeypatch, missing, newer):
    if newer:
        monkeypatch.setattr(np, "fromfile", read_as_newer_numpy)
    write_ply(tmp_path / "s.ply", random_gaussians(4, 0))
    PlyData(PlyData.read(str(tmp_path / "s.ply")).elements, text=True).write(str(tmp_path / "t.ply"))
    lines = (tmp_path / "t.ply").read_text().splitlines()
    lines[-missing] = "oops " + lines[-missing]
    (tmp_path / "t.ply").write_text("\n".join(lines))
    with pytest.raises(InputError, match=f"{missing} of 4"):
        read_ply(tmp_path / "t.ply")


def header(count: int | str, encoding: str = "binary_little_endian", more: str = "") -> bytes:
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"]
    names += [*(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]
    properties = "".join(f"property float {name}\n" for name in names)
    return f"ply\nformat {encoding} 1.0\nelement vertex {count}\n{properties}{more}end_header\n".encode()


@pytest.mark.parametrize("encoding", ["binary_little_endian", "binary_big_endian", "ascii"])
def test_a_header_that_claims_a_million_million_gaussians_is_not_believed(tmp_path, encoding):
    (tmp_path / "s.ply").write_bytes(header(10**12, encoding) + bytes(1000))
    with pytest.raises(InputError, match=f"of {10**12} Gaussians are missing"):
        read_ply(tmp_path / "s.ply")


def test_more_gaussians_take_no_more_calls(tmp_path):
    write_ply(tmp_path / "few.ply", random_gaussians(10, 0))
    write_ply(tmp_path / "many.ply", random_gaussians(10_000, 0))
    few, many = (function_calls(lambda name=name: read_ply(tmp_path / name)) for name in ("few.ply", "many.ply"))
    assert many < 2 * few


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
        b"ply\n" + b"c" * 100_000,
        b"ply\nformat binary_little_endian 1.0\nelement chunk 1\nproperty float min_x\nend_header\n",
        header("many"),
        header(10**1000),
        header(1, "binary_middle_endian"),
        header(1, more="property list uchar int parts\n"),
        header(1, more="property float x\n"),
        header(1, more="property float f_rest_0\n"),
        header(0, more="element vertex 0\n"),
    ],
    ids=[
        "empty",
        "no-ply",
        "no-header",
        "mesh",
        "huge-count",
        "faces-first",
        "endless-header",
        "endless-line",
        "compressed",
        "no-count",
        "endless-count",
        "encoding",
        "list",
        "twice",
        "degree",
        "two-vertex-elements",
    ],
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
