"""SPZ files: as the reference implementation reads and writes them, and safe with damaged ones."""

import base64
import contextlib
import gzip
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.errors import InputError
from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.io.spz import read_spz, write_spz

# `waves(3, degree)` as encoded by the reference implementation (nianticlabs/spz, commit 21715c3), by version:
# degree and file. Made with PackOptions.from = RDF, the axes of PLY files.
REFERENCE = {
    2: (
        1,
        """
        H4sIAAAAAAAAAwFkAJv/TkdTUAIAAAADAAAAAQwAAKp6AoyjAIVQAjw8AfgA/uu/AWR0/iPa/RYC//pDBqJ3YHxejF2HoJBUNHiGPkKJ
        c2nQVUS0NiuNKEgo0MggUBBw8BjA2ChA6GDwiLjgMDjgsPCYEKZeouRkAAAA
        """,
    ),
    3: (
        3,
        """
        H4sIAAAAAAAAA/NzDw5gZmBgAGMeBoZVVUw9ixlaA5hsbBh/MPx7vZ8xpeSf8q2/Ykz/fzmzLSpPWFQZv6gmbkKISUWbnVNn8Rel588b
        V8tMPab1c66HxoUTCgECBR8mfAh44GDw4IDAAoEGgQUfNjwwuAAWB3IUDly4cEBhgUBBgMKJCwoeEhkfGj4kfHBQAApuECgQmABU7HBB
        wUEgAaRY4MCDCxdA4hESB25oOEgABT8UfAhQgAgKNHxY8MHhgYGDQsKHCQITBDZAFCcAAKo+ji/TAAAA
        """,
    ),
    4: (
        1,
        """
        TkdTUAQAAAADAAAAAQwABiAAAAAAAAAAAAAAAAAAAAAkAAAAAAAAABsAAAAAAAAADAAAAAAAAAADAAAAAAAAABIAAAAAAAAACQAAAAAA
        AAASAAAAAAAAAAkAAAAAAAAAFQAAAAAAAAAMAAAAAAAAACQAAAAAAAAAGwAAAAAAAAAotS/9IBvZAACqegKMowCFUAI8PAH4AP7rvwFk
        dP4j2v0WAv8otS/9IAMZAAD6QwYotS/9IAlJAACid2B8Xoxdh6AotS/9IAlJAACQVDR4hj5CiXMotS/9IAxhAAD0IufngasclcYq+Z0o
        tS/9IBvZAABIKNDIIFAQcPAYwNgoQOhg8Ii44DA44LDwmBA=
        """,
    ),
}


def waves(count: int, degree: int) -> Gaussians:
    def wave(*shape: int, size: float) -> np.ndarray:
        return (size * np.sin(np.arange(1, np.prod(shape) + 1) * 1.7).reshape(shape)).astype(np.float32)

    return Gaussians(
        means=wave(count, 3, size=40.0),
        log_scales=wave(count, 3, size=3.0) - 4.0,
        quaternions=wave(count, 4, size=2.0),
        opacity_logits=wave(count, size=4.0),
        sh=wave(count, (degree + 1) ** 2, 3, size=0.9),
    )


def unit(quaternions: np.ndarray) -> np.ndarray:
    """Of length one, and of the two that are the same rotation the one with the largest component positive."""
    largest = np.take_along_axis(quaternions, np.abs(quaternions).argmax(axis=1)[:, None], axis=1)
    return quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True) * np.sign(largest)


def assert_close(result: Gaussians, original: Gaussians, *, rotation: float, position: float = 2**-13) -> None:
    """What the format promises: half a step of every number, or of a bucket of steps."""
    np.testing.assert_allclose(result.means, original.means, atol=position)
    np.testing.assert_allclose(result.log_scales, original.log_scales, atol=1 / 32 + 1e-6)
    np.testing.assert_allclose(np.abs((unit(result.quaternions) * unit(original.quaternions)).sum(1)), 1, atol=rotation)
    np.testing.assert_allclose(result.opacities, original.opacities, atol=0.51 / 255)
    np.testing.assert_allclose(result.sh[:, 0], original.sh[:, 0], atol=0.51 / (0.15 * 255))
    np.testing.assert_allclose(result.sh[:, 1:4], original.sh[:, 1:4], atol=4.51 / 128)
    np.testing.assert_allclose(result.sh[:, 4:], original.sh[:, 4:], atol=8.51 / 128)


@pytest.mark.parametrize("version", [2, 3, 4])
def test_files_of_the_reference_implementation_are_read(tmp_path, version):
    degree, text = REFERENCE[version]
    (tmp_path / "r.spz").write_bytes(base64.b64decode(text))
    assert_close(read_spz(tmp_path / "r.spz"), waves(3, degree), rotation=2e-4 if version == 2 else 4e-6)


@pytest.mark.parametrize("version", [2, 3])
def test_what_is_written_is_what_the_reference_implementation_writes(tmp_path, version):
    degree, text = REFERENCE[version]
    write_spz(tmp_path / "s.spz", waves(3, degree), version)
    ours, reference = (gzip.decompress(x) for x in ((tmp_path / "s.spz").read_bytes(), base64.b64decode(text)))
    assert ours == reference


@given(
    count=st.integers(0, 20),
    degree=st.integers(0, 3),
    version=st.sampled_from([2, 3]),
    exponent=st.integers(-3, 3),
    seed=st.integers(0, 1000),
)
@settings(deadline=None, max_examples=40)
def test_what_is_read_back_differs_by_the_rounding_alone(tmp_path_factory, count, degree, version, exponent, seed):
    path = tmp_path_factory.mktemp("spz") / "s.spz"
    rng = np.random.default_rng(seed)
    size = 10.0**exponent
    original = Gaussians(
        means=(size * rng.standard_normal((count, 3))).astype(np.float32),
        log_scales=rng.uniform(-9.9, 5.9, (count, 3)).astype(np.float32),
        quaternions=rng.standard_normal((count, 4)).astype(np.float32),
        opacity_logits=rng.uniform(-20.0, 20.0, count).astype(np.float32),
        sh=rng.uniform(-0.9, 0.9, (count, (degree + 1) ** 2, 3)).astype(np.float32),
    )
    write_spz(path, original, version)
    result = read_spz(path)
    farthest = np.abs(original.means).max(initial=0.0)
    spread = np.median(np.abs(original.means - np.median(original.means, axis=0)).max(axis=1)) if count else 0.0
    promised = 2.0**-16 * spread if count > 1 else 2.0**-13
    # x, y and z in a byte each say little of a rotation by nearly 180 degrees, whose w follows from them.
    rotation = 2e-2 if version == 2 else 4e-6
    assert_close(result, original, rotation=rotation, position=max(promised, 2.0**-22 * farthest))
    write_spz(path, result, version)
    again = read_spz(path)
    np.testing.assert_allclose(again.opacity_logits, result.opacity_logits, atol=1e-6)
    np.testing.assert_allclose(again.sh, result.sh, atol=1e-6)


def test_a_scene_too_far_out_is_refused_and_nothing_is_written(tmp_path):
    far = waves(3, 0)
    far.means[1, 2] = 1e7
    with pytest.raises(InputError, match="1e\\+07 units"):
        write_spz(tmp_path / "far.spz", far)
    assert list(tmp_path.iterdir()) == []


def test_a_gaussian_so_far_out_that_all_positions_would_suffer_is_refused(tmp_path):
    scene = waves(300, 0)
    size = float(np.abs(scene.means).max())
    scene.means[7, 1] = 1000.0 * size
    write_spz(tmp_path / "s.spz", scene)
    np.testing.assert_allclose(read_spz(tmp_path / "s.spz").means, scene.means, atol=2.0**-12 * size)
    scene.means[7, 1] = 1e6
    with pytest.raises(InputError, match=r"1e\+06 units from the origin, so that SPZ would round all .* 0\.12 units"):
        write_spz(tmp_path / "far.spz", scene)
    assert not (tmp_path / "far.spz").exists()
    write_spz(tmp_path / "alone.spz", scene.take(np.array([7])))  # there is no size to be precise about


@pytest.mark.parametrize("longest", [-12.5, 6.5, -np.inf])
def test_units_in_which_sizes_do_not_fit_are_refused_and_nothing_is_written(tmp_path, longest):
    scene = waves(300, 0)
    scene.log_scales[:4] = longest
    with pytest.raises(InputError, match=r"4 of 300 Gaussians are smaller than 4.5e-05 or larger than 379 units"):
        write_spz(tmp_path / "s.spz", scene)
    assert list(tmp_path.iterdir()) == []


def test_a_few_sizes_beyond_the_range_and_flat_gaussians_are_clipped(tmp_path):
    scene = waves(300, 0)
    scene.log_scales[:, 1] = -30.0
    scene.log_scales[:3] = ((-12.5,) * 3, (6.5,) * 3, (-1.0,) * 3)
    write_spz(tmp_path / "s.spz", scene)
    np.testing.assert_array_equal(read_spz(tmp_path / "s.spz").log_scales[:3, 0], (-10.0, 5.9375, -1.0))


def gzip_of(version: int = 3, count: int = 3, degree: int = 0, bits: int = 12, body: bytes = bytes(60)) -> bytes:
    return gzip.compress(struct.pack("<4sIIBBBB", b"NGSP", version, count, degree, bits, 0, 0) + body, mtime=0)


def streams_of(count: int, streams: int, offset: int, body: bytes) -> bytes:
    return struct.pack("<4sIIBBBBI12x", b"NGSP", 4, count, 0, 12, 0, streams, offset) + body


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "not an SPZ file"),
        (gzip.compress(b"something else altogether", mtime=0), "not an SPZ file"),
        (gzip_of()[:-8], "cut short"),
        (gzip_of(body=bytes(59)), "cut short"),
        (gzip_of(count=2**32 - 1), "cut short"),
        (gzip_of(version=1), "version 1"),
        (gzip_of(version=9), "version 9"),
        (gzip_of(degree=200), "SH degree 200"),
        (gzip_of(bits=255), "255 fractional bits"),
        (gzip_of()[:-8] + bytes(8), "damaged"),
        (streams_of(3, 5, 32, b""), "cut short"),
        (streams_of(2**32 - 1, 5, 32, bytes(80)), "cut short"),
        (streams_of(3, 5, 2**32 - 1, bytes(80)), "cut short"),
        (streams_of(3, 5, 32, bytes(80)), "table of contents"),
        (streams_of(3, 5, 32, b"".join(struct.pack("<QQ", 9, 3 * n) for n in (9, 1, 3, 3, 4)) + bytes(45)), "damaged"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_line(tmp_path, content, said):
    (tmp_path / "bad.spz").write_bytes(content)
    with pytest.raises(InputError, match=said) as caught:
        read_spz(tmp_path / "bad.spz")
    assert "bad.spz" in str(caught.value)
    assert "\n" not in str(caught.value)


@given(cut=st.integers(0, 400), flip=st.integers(0, 400), value=st.integers(0, 255), version=st.sampled_from([2, 3, 4]))
@settings(deadline=None, max_examples=60)
def test_damage_anywhere_gives_gaussians_or_an_input_error(tmp_path_factory, cut, flip, value, version):
    data = bytearray(base64.b64decode(REFERENCE[version][1]))
    data[flip % len(data)] = value
    path = tmp_path_factory.mktemp("spz") / "damaged.spz"
    path.write_bytes(data[: len(data) - cut % len(data) if cut < 200 else len(data)])
    with contextlib.suppress(InputError):
        assert len(read_spz(path)) <= 3
