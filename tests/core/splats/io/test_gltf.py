"""GLB files: what KHR_gaussian_splatting asks for, the geometry once, and safe with damaged ones."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cvdgs.core.color.srgb import encode
from cvdgs.core.errors import InputError
from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.io.files import read_gaussians, read_layers, write_layers
from cvdgs.core.splats.io.gltf import read_glb, write_glb
from cvdgs.core.splats.io.layers import TO_Y_UP
from cvdgs.core.splats.strategy.editing import rotate

from .test_splat_files import cloud, rotations_differ_by, run

EXTENSION = "KHR_gaussian_splatting"


def layers(count: int, degree: int = 0, *others: str) -> dict[str, Gaussians]:
    """Random Gaussians, and layers of degree 0 of the same."""
    first = cloud(count, degree)
    return {
        "original": first,
        **{name: replace(first, sh=cloud(count, 0, seed).sh) for seed, name in enumerate(others, 1)},
    }


def parts(path: Path) -> tuple[dict[str, Any], bytes]:
    """Description and numbers, by the GLB container of the glTF 2.0 specification."""
    data = path.read_bytes()
    magic, version, length, text_length, kind = struct.unpack_from("<4sII I4s", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    assert text_length % 4 == 0
    rest = data[20 + text_length :]
    assert struct.unpack_from("<I4s", rest) == (len(rest) - 8, b"BIN\0")
    return json.loads(data[20 : 20 + text_length]), rest[8:]


def join(path: Path, document: dict[str, Any], numbers: bytes) -> Path:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(numbers), b"BIN\0") + numbers
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


def attribute(path: Path, semantic: str, mesh: int = 0) -> np.ndarray:
    """The numbers of an attribute, looked up by hand."""
    document, numbers = parts(path)
    accessor = document["accessors"][document["meshes"][mesh]["primitives"][0]["attributes"][semantic]]
    view = document["bufferViews"][accessor["bufferView"]]
    kind = {5126: np.float32, 5123: np.uint16}[accessor["componentType"]]
    shape = accessor["count"], {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
    assert view["byteLength"] == np.prod(shape) * np.dtype(kind).itemsize
    return np.frombuffer(numbers, kind, int(np.prod(shape)), view["byteOffset"]).reshape(shape)


@given(count=st.integers(1, 20), degree=st.integers(0, 3), seed=st.integers(0, 1000))
@settings(deadline=None, max_examples=30)
def test_what_is_written_is_read_again(tmp_path_factory, count, degree, seed):
    path = tmp_path_factory.mktemp("glb") / "s.glb"
    original = cloud(count, degree, seed)
    write_glb(path, {"original": original})
    result = read_gaussians(path)
    np.testing.assert_array_equal(result.means, original.means)
    np.testing.assert_array_equal(result.sh, original.sh)
    np.testing.assert_allclose(result.log_scales, original.log_scales, rtol=0, atol=1e-6)
    np.testing.assert_allclose(result.opacity_logits, original.opacity_logits, rtol=0, atol=1e-4)
    assert rotations_differ_by(result, original) < 0.1


def test_attributes_are_what_the_extension_says(tmp_path):
    path, original = tmp_path / "s.glb", cloud(50, 2)
    write_glb(path, {"original": original})
    np.testing.assert_array_equal(attribute(path, "POSITION"), original.means)
    np.testing.assert_allclose(attribute(path, f"{EXTENSION}:SCALE"), np.exp(original.log_scales), rtol=1e-6)
    opacities = 1.0 / (1.0 + np.exp(-original.opacity_logits[:, None]))
    np.testing.assert_allclose(attribute(path, f"{EXTENSION}:OPACITY"), opacities, rtol=1e-6)
    rotations = attribute(path, f"{EXTENSION}:ROTATION")
    np.testing.assert_allclose(np.linalg.norm(rotations, axis=1), 1.0, rtol=1e-6)
    lengths = np.linalg.norm(original.quaternions, axis=1)
    np.testing.assert_allclose(rotations[:, 3] * lengths, original.quaternions[:, 0], rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(attribute(path, f"{EXTENSION}:SH_DEGREE_0_COEF_0"), original.sh[:, 0])
    np.testing.assert_array_equal(attribute(path, f"{EXTENSION}:SH_DEGREE_1_COEF_2"), original.sh[:, 3])
    np.testing.assert_array_equal(attribute(path, f"{EXTENSION}:SH_DEGREE_2_COEF_0"), original.sh[:, 4])
    points = attribute(path, "COLOR_0") / 65535.0
    np.testing.assert_allclose(encode(points[:, :3]), np.clip(original.base_colors, 0.0, 1.0), atol=2e-4)
    np.testing.assert_allclose(points[:, 3:], opacities, atol=1e-5)


def test_the_description_has_what_the_specifications_require(tmp_path):
    path, original = tmp_path / "s.glb", layers(7, 3, "deutan-1.0")
    write_glb(path, original)
    document, numbers = parts(path)
    assert document["asset"]["version"] == "2.0"
    assert document["extensionsUsed"] == [EXTENSION]
    assert document["buffers"] == [{"byteLength": len(numbers)}]
    for mesh in document["meshes"]:
        (primitive,) = mesh["primitives"]
        assert primitive["mode"] == 0
        assert primitive["extensions"][EXTENSION] == {
            "kernel": "ellipse",
            "colorSpace": "srgb_rec709_display",
            "projection": "perspective",
            "sortingMethod": "cameraDistance",
        }
    (first,) = document["meshes"][0]["primitives"]
    terms = {f"{EXTENSION}:SH_DEGREE_{n}_COEF_{i}" for n in range(4) for i in range(2 * n + 1)}
    others = {"POSITION", "COLOR_0", *(f"{EXTENSION}:{name}" for name in ("ROTATION", "SCALE", "OPACITY"))}
    assert set(first["attributes"]) == terms | others
    position = document["accessors"][first["attributes"]["POSITION"]]
    assert position["min"] == original["original"].means.min(axis=0).tolist()
    assert position["max"] == original["original"].means.max(axis=0).tolist()
    for accessor in document["accessors"]:
        view = document["bufferViews"][accessor["bufferView"]]
        assert accessor["count"] == 7
        assert view["byteOffset"] % 4 == 0
        assert view["byteOffset"] + view["byteLength"] <= len(numbers)
        # Of a colour, whole numbers have to say that they are fractions (glTF 2.0, 3.7.2.1).
        assert accessor.get("normalized", False) == (accessor["componentType"] == 5123)


def test_every_layer_is_a_scene_of_its_own_and_the_first_is_shown(tmp_path):
    path = tmp_path / "s.glb"
    write_glb(path, layers(5, 1, "deutan-1.0", "tritan-0.5"))
    document, _ = parts(path)
    assert document["scene"] == 0
    for scene, name in zip(document["scenes"], ["original", "deutan-1.0", "tritan-0.5"], strict=True):
        assert scene["name"] == name
        (node,) = (document["nodes"][number] for number in scene["nodes"])
        assert document["meshes"][node["mesh"]]["name"] == node["name"] == name
    assert "COLOR_0" not in document["meshes"][1]["primitives"][0]["attributes"]


def test_a_layer_adds_its_colours_and_nothing_else(tmp_path):
    count = 1000
    original = layers(count, 2, "deutan-1.0")
    write_glb(tmp_path / "one.glb", {"original": original["original"]})
    write_glb(tmp_path / "two.glb", original)
    one, two = (len(parts(tmp_path / name)[1]) for name in ("one.glb", "two.glb"))
    assert two - one == 12 * count
    document, _ = parts(tmp_path / "two.glb")
    first, second = (mesh["primitives"][0]["attributes"] for mesh in document["meshes"])
    shared = {semantic for semantic in second if first[semantic] == second[semantic]}
    assert shared == {"POSITION", *(f"{EXTENSION}:{name}" for name in ("ROTATION", "SCALE", "OPACITY"))}
    result = read_glb(tmp_path / "two.glb")
    assert list(result) == list(original)
    for name, gaussians in result.items():
        np.testing.assert_array_equal(gaussians.sh, original[name].sh)


@pytest.mark.parametrize("axis", TO_Y_UP)
def test_the_axis_that_points_up_becomes_y(tmp_path, axis):
    path, original = tmp_path / "s.glb", cloud(3)
    write_layers(path, {"original": original}, up=axis)
    x, y, z, w = parts(path)[0]["nodes"][0]["rotation"]
    up = np.eye(3)["xyz".index(axis[-1])] * (-1.0 if axis[0] == "-" else 1.0)
    turned = rotate(np.array([[w, x, y, z]]), up[None])
    np.testing.assert_allclose(turned, [[0.0, 1.0, 0.0]], atol=1e-7)
    np.testing.assert_array_equal(read_gaussians(path).means, original.means)


def test_without_that_axis_the_scene_stands_as_it_is(tmp_path):
    write_glb(tmp_path / "s.glb", {"original": cloud(3)})
    assert parts(tmp_path / "s.glb")[0]["nodes"] == [{"name": "original", "mesh": 0}]


def test_ends_of_the_range_survive(tmp_path):
    original = cloud(2)
    original.log_scales[:] = ((-200.0,) * 3, (200.0,) * 3)
    original.opacity_logits[:] = (-1000.0, 1000.0)
    original.quaternions[:] = ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, -5.0, 0.0))
    original.sh[:] = np.float32([-100.0, 100.0])[:, None, None]
    write_glb(tmp_path / "s.glb", {"original": original})
    result = read_gaussians(tmp_path / "s.glb")
    assert (result.log_scales[0] < -40.0).all()
    assert (result.log_scales[1] > 80.0).all()
    np.testing.assert_allclose(result.opacities, [0.0, 1.0], atol=1e-6)
    np.testing.assert_array_equal(result.quaternions, [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]])
    assert attribute(tmp_path / "s.glb", "COLOR_0").tolist() == [[0, 0, 0, 0], [65535] * 4]


def test_no_gaussians_are_not_written(tmp_path):
    with pytest.raises(InputError, match="no Gaussians to write"):
        write_glb(tmp_path / "s.glb", {"original": cloud(0)})
    assert list(tmp_path.iterdir()) == []


def first_primitive(document: dict[str, Any]) -> dict[str, Any]:
    return document["meshes"][0]["primitives"][0]


def set_attribute(name: str, value: object):
    return lambda document: first_primitive(document)["attributes"].update({f"{EXTENSION}:{name}": value})


def set_splatting(**values: object):
    return lambda document: first_primitive(document)["extensions"][EXTENSION].update(values)


def set_entry(kind: str, number: int = 0, **values: object):
    return lambda document: document[kind][number].update(values)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda document: document.update(meshes=[]), "without Gaussians"),
        (lambda document: document.update(meshes=7), "without Gaussians"),
        (lambda document: first_primitive(document).pop("extensions"), "without Gaussians"),
        (lambda document: document.update(extensionsRequired=["KHR_x"]), "needs the glTF extension KHR_x"),
        (lambda document: document.update(extensionsRequired=7), "needs the glTF extension 7"),
        (set_splatting(colorSpace="lin_rec709_display"), "another kind than display-referred sRGB"),
        (set_splatting(kernel="box"), "another kind"),
        (set_splatting(extensions={"spz": {}}), "another kind"),
        (set_attribute("SCALE", 99), "refers to accessors that are not there"),
        (set_attribute("SCALE", -1), "refers to accessors that are not there"),
        (set_attribute("SCALE", True), "refers to accessors that are not there"),
        (set_attribute("SH_DEGREE_2_COEF_0", 5), "refers to accessors that are not there"),
        (set_attribute("ROTATION", 0), "not plain float32 VEC4"),
        (set_entry("accessors", componentType=5121), "not plain float32 VEC3"),
        (set_entry("accessors", count=10**12), r"it claims 1,000,000,000,000 Gaussians"),
        (set_entry("accessors", count=10**5), "cut short"),
        (set_entry("accessors", count=6), "differ in length"),
        (set_entry("accessors", 5, count=6), "differ in length"),
        (set_entry("accessors", count="7"), "no usable count"),
        (set_entry("accessors", byteOffset=12), "cut short"),
        (set_entry("bufferViews", byteOffset=-4), "no usable byteOffset"),
        (set_entry("bufferViews", byteOffset=10**9), "cut short"),
        (set_entry("bufferViews", byteStride=64), "interleaved"),
        (set_entry("bufferViews", buffer=1), "interleaved or in another file"),
        (set_entry("nodes", matrix=[1] * 16), "move or stretch"),
        (set_entry("nodes", translation=[1, 0, 0]), "move or stretch"),
        *((set_entry("nodes", scale=value), "move or stretch") for value in ([1, 2, 1], [0] * 3, [2], ["2"] * 3, 2)),
    ],
)
def test_descriptions_that_are_damaged_or_not_ours_are_refused_in_one_line(tmp_path, change, said):
    write_glb(tmp_path / "s.glb", layers(7, 1))
    document, numbers = parts(tmp_path / "s.glb")
    change(document)
    with pytest.raises(InputError, match=said) as caught:
        read_glb(join(tmp_path / "s.glb", document, numbers))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (set_entry("meshes", 1, name="original"), "two of its layers are called 'original'"),
        (set_attribute("SCALE", 0), "different Gaussians, not layers of one scene"),
        (set_entry("nodes", scale=[2.0] * 3), "scale what they hold differently"),
    ],
)
def test_meshes_that_are_no_layers_are_refused(tmp_path, change, said):
    write_glb(tmp_path / "s.glb", layers(7, 1, "deutan-1.0"))
    document, numbers = parts(tmp_path / "s.glb")
    change(document)
    with pytest.raises(InputError, match=said):
        read_glb(join(tmp_path / "s.glb", document, numbers))


def test_a_unit_that_is_not_a_metre_leaves_the_numbers_as_they_are(tmp_path):
    original = layers(6, 1, "deutan-1.0")
    write_glb(tmp_path / "s.glb", original, "-y", metres=0.37)
    for name, gaussians in read_glb(tmp_path / "s.glb").items():
        np.testing.assert_array_equal(gaussians.means, original[name].means)
        np.testing.assert_allclose(gaussians.log_scales, original[name].log_scales, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "value"),
    [("SCALE", -1.0), ("SCALE", np.nan), ("OPACITY", 1.5), ("OPACITY", -0.1), ("ROTATION", np.inf)],
)
def test_values_that_no_gaussian_has_are_refused_or_left_out(tmp_path, name, value):
    path, original = tmp_path / "s.glb", cloud(9)
    write_glb(path, {"original": original})
    document, numbers = parts(path)
    accessor = first_primitive(document)["attributes"][f"{EXTENSION}:{name}"]
    start = document["bufferViews"][accessor]["byteOffset"]
    join(path, document, numbers[:start] + struct.pack("<f", value) + numbers[start + 4 :])
    with pytest.raises(InputError, match="1 of 9 Gaussians"):
        read_gaussians(path)
    np.testing.assert_array_equal(read_gaussians(path, drop_damaged=True).means, original.means[1:])


@pytest.mark.parametrize(
    ("start", "said"),
    [
        (b"glTF", "cut short"),
        (struct.pack("<4sII", b"glTF", 1, 100) + bytes(8), "not a GLB file of glTF 2.0"),
        (struct.pack("<4sIII4s", b"glTF", 2, 100, 2**31, b"JSON"), "2,147,483,648 bytes, 1,048,576 is the limit"),
        (struct.pack("<4sIII4s", b"glTF", 2, 28, 0, b"JSON") + struct.pack("<I4s", 0, b"JSON"), "no numbers beside"),
        (struct.pack("<4sIII4s", b"glTF", 2, 28, 0, b"JSON") + struct.pack("<I4s", 0, b"BIN\0"), "not valid JSON"),
        (struct.pack("<4sIII4s", b"glTF", 2, 30, 2, b"JSON") + b"[]" + struct.pack("<I4s", 0, b"BIN\0"), "describes"),
        (struct.pack("<4sIII4s", b"glTF", 2, 30, 2, b"JSON") + b"{}" + struct.pack("<I4s", 9, b"BIN\0"), "cut short"),
    ],
)
def test_containers_that_are_damaged_are_refused(tmp_path, start, said):
    (tmp_path / "s.glb").write_bytes(start)
    with pytest.raises(InputError, match=said):
        read_gaussians(tmp_path / "s.glb")


def test_files_of_other_gaussians_are_no_layers(tmp_path):
    for seed, name in enumerate(("splats.ply", "splats.deutan-1.0.ply")):
        write_layers(tmp_path / name, {"original": cloud(4, seed=seed)})
    with pytest.raises(InputError, match=r"deutan-1.0.ply: its Gaussians are others .* splats.<layer>.ply of one run"):
        read_layers([tmp_path / "splats.ply", tmp_path / "splats.deutan-1.0.ply"])
    with pytest.raises(InputError, match="a second layer called 'original'"):
        read_layers([tmp_path / "splats.ply", tmp_path / "splats.ply"])


def test_a_damaged_gaussian_is_dropped_from_all_layers(tmp_path):
    original = layers(5, 1, "deutan-1.0")
    original["deutan-1.0"].sh[3] = np.nan
    for name, file in (("original", "splats.ply"), ("deutan-1.0", "splats.deutan-1.0.ply")):
        write_layers(tmp_path / file, {name: original[name]})
    paths = [tmp_path / "splats.ply", tmp_path / "splats.deutan-1.0.ply"]
    with pytest.raises(InputError, match=r"splats.deutan-1.0.ply: 1 of 5 Gaussians"):
        read_layers(paths)
    kept = read_layers(paths, drop_damaged=True)
    assert list(kept) == ["original", "deutan-1.0"]
    for gaussians in kept.values():
        np.testing.assert_array_equal(gaussians.means, np.delete(original["original"].means, 3, axis=0))


def test_a_run_says_itself_what_is_up_and_how_long_a_metre_is(tmp_path):
    write_layers(tmp_path / "splats.ply", layers(6, 1))
    up = np.array([0.6, -0.64, 0.48])
    for stated in (up.tolist(), [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]):
        report = {"capture": {"up": stated, "metres_per_unit": 2.5}}
        (tmp_path / "report.json").write_text(json.dumps(report))
        assert run(tmp_path / "splats.ply", tmp_path / "s.glb").returncode == 0
        node = parts(tmp_path / "s.glb")[0]["nodes"][0]
        turned = Rotation.from_quat(node["rotation"]).apply(stated)
        np.testing.assert_allclose(turned, (0.0, 1.0, 0.0), atol=1e-5)
        assert node["scale"] == [2.5] * 3
    for damaged in ({"capture": {"up": [0, 0, 0]}}, {"capture": 3}, []):
        (tmp_path / "report.json").write_text(json.dumps(damaged))
        assert run(tmp_path / "splats.ply", tmp_path / "s.glb").returncode == 0
        assert "rotation" not in parts(tmp_path / "s.glb")[0]["nodes"][0]


def test_the_script_gathers_a_run_in_one_file_and_takes_it_apart(tmp_path):
    original = layers(6, 1, "deutan-1.0")
    for name, file in (("original", "splats.ply"), ("deutan-1.0", "splats.deutan-1.0.ply")):
        write_layers(tmp_path / file, {name: original[name]})
    done = run(tmp_path / "splats.ply", tmp_path / "splats.deutan-1.0.ply", tmp_path / "s.glb", "--up=-y")
    assert (done.returncode, done.stderr) == (0, "")
    assert "layers original, deutan-1.0" in done.stdout
    for arguments, said in (
        (("a.ply",), "a .ply file holds one layer, not 2 - write .glb, .usd or .html, or choose one"),
        (("a.ply", "--layer", "tritan"), "there is no layer 'tritan' - name original or deutan-1.0"),
        (("a.ply", "--layer", "original", "--up", "z"), "a .ply file cannot say what is up"),
        (("a.glb", "--up", "w"), "invalid choice: 'w'"),
    ):
        done = run(tmp_path / "s.glb", tmp_path / arguments[0], *arguments[1:])
        assert done.returncode == 2
        assert said in done.stderr
        assert done.stderr.count("\n") == 1
        assert not (tmp_path / arguments[0]).exists()
    assert run(tmp_path / "s.glb", tmp_path / "a.ply", "--layer", "deutan-1.0").returncode == 0
    np.testing.assert_array_equal(read_gaussians(tmp_path / "a.ply").sh, original["deutan-1.0"].sh)


def test_a_terminal_is_not_sent_what_a_file_calls_its_layers(tmp_path):
    write_glb(tmp_path / "s.glb", layers(3, 0, "\x1b[2J\n\ud800"))
    done = run(tmp_path / "s.glb", tmp_path / "t.glb")
    assert done.returncode == 0
    assert done.stdout.strip().isprintable()
    assert list(read_glb(tmp_path / "t.glb")) == ["original", "\x1b[2J\n\ud800"]
