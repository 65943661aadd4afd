"""Video files as telephones make them, and as nobody wants them."""

from __future__ import annotations

import shutil
import struct
import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from cvdgs.core.capture.reader import inspect_capture, read_capture, write_thumbnails
from cvdgs.core.errors import InputError
from cvdgs.core.intake import video
from cvdgs.core.intake.selection import choose
from cvdgs.core.intake.video import extract, look_through, read_video_header
from cvdgs.core.runtime.resources import peak_memory_mb

from ..capture.make_captures import shots, write_transforms
from .films import HEIGHT, RATE, WIDTH, wall, window, write_video
from .test_archive import write_zip

WALL = wall()
WALK = [window(WALL, 50 + 4 * step) for step in range(RATE * 2)]
CLOCKWISE = (0, 1 << 16, 0, -(1 << 16), 0, 0, HEIGHT << 16, 0, 1 << 30)  # by 90°, as telephones held upright write


def refused(path: Path) -> str:
    def use() -> None:
        inspect_capture(path)
        look_through(path)

    with pytest.raises(InputError) as error:
        use()
    assert "\n" not in str(error.value)
    return str(error.value)


def first_picture(path: Path, folder: Path) -> np.ndarray:
    look = look_through(path)
    extract(look, look.film.frames[:1], folder, look.white)
    return np.asarray(Image.open(folder / "000000.jpg"))


def turned(data: bytes, matrix: tuple[int, ...]) -> bytes:
    """An MP4 with another matrix in its track's header (ISO/IEC 14496-12, 8.3.2), as a telephone writes it."""
    at = data.index(b"tkhd") + 4 + 40
    return data[:at] + struct.pack(">9i", *matrix) + data[at + 36 :]


@pytest.mark.parametrize(
    ("matrix", "turns"),
    [
        (CLOCKWISE, 3),
        ((-(1 << 16), 0, 0, 0, -(1 << 16), 0, WIDTH << 16, HEIGHT << 16, 1 << 30), 2),
        ((0, -(1 << 16), 0, 1 << 16, 0, 0, 0, WIDTH << 16, 1 << 30), 1),
    ],
    ids=["clockwise", "upside-down", "anticlockwise"],
)
def test_rotation_is_applied(tmp_path: Path, matrix: tuple[int, ...], turns: int) -> None:
    path = write_video(tmp_path / "x.mp4", WALK)
    plain = first_picture(path, tmp_path / "plain")
    path.write_bytes(turned(path.read_bytes(), matrix))
    picture = first_picture(path, tmp_path / "turned")
    assert picture.shape == np.rot90(plain, turns).shape
    assert np.abs(picture.astype(int) - np.rot90(plain, turns)).mean() < 2.0
    header = read_video_header(path)
    assert (header.width, header.height) == (picture.shape[1], picture.shape[0])


@pytest.mark.parametrize(("aspect", "squeezed"), [(Fraction(4, 3), (240, 192)), (Fraction(3, 4), (320, 144))])
def test_pixels_that_are_not_square_are_made_square(
    tmp_path: Path, aspect: Fraction, squeezed: tuple[int, int]
) -> None:
    def configure(stream: av.VideoStream) -> None:
        stream.codec_context.sample_aspect_ratio = aspect

    stored = [np.asarray(Image.fromarray(frame).resize(squeezed, Image.Resampling.BICUBIC)) for frame in WALK]
    path = write_video(tmp_path / "x.mp4", stored, configure=configure)
    size = (240, 144)  # of 320 x 192, with nothing enlarged
    expected = np.asarray(Image.fromarray(WALK[0]).resize(size, Image.Resampling.BICUBIC)).astype(int)
    picture = first_picture(path, tmp_path / "out")
    assert picture.shape == expected.shape
    assert np.abs(picture - expected).mean() < 4.0
    found = inspect_capture(path)
    assert found.sizes == ((*size, 1),)
    write_thumbnails(path, tmp_path / "small", count=1, size=120)
    assert Image.open(tmp_path / "small" / "0.png").size == (120, 72)
    path.write_bytes(turned(path.read_bytes(), CLOCKWISE))
    header = read_video_header(path)
    assert (header.width, header.height) == size[::-1]
    assert np.abs(first_picture(path, tmp_path / "turned") - np.rot90(expected, 3)).mean() < 4.0


def test_a_converters_rounded_pixel_aspect_changes_no_pixel(tmp_path: Path) -> None:
    def configure(stream: av.VideoStream) -> None:
        stream.codec_context.sample_aspect_ratio = Fraction(1280, 1281)

    plain = first_picture(write_video(tmp_path / "plain.mp4", WALK), tmp_path / "plain")
    path = write_video(tmp_path / "x.mp4", WALK, configure=configure)
    assert (first_picture(path, tmp_path / "out") == plain).all()


def test_a_variable_frame_rate_keeps_its_times(tmp_path: Path) -> None:
    gaps = np.random.default_rng(0).integers(10, 60, len(WALK))
    times = [int(value) for value in np.cumsum(gaps)]
    look = look_through(write_video(tmp_path / "x.mkv", WALK, times=times))
    found = np.array([frame.time for frame in look.film.frames])
    assert np.abs((found - found[0]) - (np.array(times) - times[0]) / 600.0).max() < 0.002


def sound_alone(path: Path) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=48000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 4800), np.float32), format="fltp", layout="mono")
        frame.sample_rate = 48000
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def test_sound_alone_is_refused(tmp_path: Path) -> None:
    assert "no pictures" in refused(sound_alone(tmp_path / "sound.mp4"))


def cut(data: bytes) -> bytes:
    return data[: len(data) // 2]


def test_a_video_that_is_cut_before_its_index_is_refused(tmp_path: Path) -> None:
    path = write_video(tmp_path / "x.mp4", WALK)
    path.write_bytes(cut(path.read_bytes()))
    assert "damaged, cut short" in refused(path)


def test_of_a_video_that_is_cut_behind_its_index_the_part_that_is_there_is_used(tmp_path: Path) -> None:
    path = write_video(tmp_path / "x.mp4", WALK * 3, container_options={"movflags": "faststart"})
    path.write_bytes(cut(path.read_bytes()))
    look = look_through(path)
    assert look.cut_at is not None
    assert 0.5 < look.cut_at < 5.0
    (chosen,) = choose([look.film])
    assert len(extract(look, chosen, tmp_path / "out", look.white)) == len(chosen) >= 2


def test_of_a_video_that_is_too_long_the_beginning_is_used_and_it_is_not_called_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(video, "MAX_SECONDS", 1.0)
    look = look_through(write_video(tmp_path / "x.mp4", [window(WALL, 50 + step) for step in range(RATE * 4)]))
    assert (look.is_shortened, look.cut_at) == (True, None)
    assert look.film.frames[-1].time <= 1.0


@pytest.mark.slow
def test_frames_far_apart_are_found_between_key_frames_that_are_farther(tmp_path: Path) -> None:
    def configure(stream: av.VideoStream) -> None:
        stream.options = {"crf": "14", "preset": "ultrafast", "g": "1000", "sc_threshold": "0"}

    walk = [window(WALL, 50 + step) for step in range(RATE * 24)]
    look = look_through(write_video(tmp_path / "x.mp4", walk, configure=configure))
    chosen = [look.film.frames[RATE * second] for second in (1, 9, 10, 18, 23)]
    done: list[float] = []
    extract(look, chosen, tmp_path / "out", look.white, done.append)
    for frame in chosen:
        picture = np.asarray(Image.open(tmp_path / "out" / f"{frame.number:06d}.jpg")).astype(int)
        errors = [np.abs(picture - walk[number]).mean() for number in range(frame.number - 2, frame.number + 3)]
        assert np.argmin(errors) == 2
    assert done == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])


def interlaced(path: Path) -> Path:
    def configure(stream: av.VideoStream) -> None:
        stream.options = {"flags": "+ildct+ilme", "top": "1"}

    def prepare(frame: av.VideoFrame) -> None:
        pass

    return write_video(path, WALK, codec="mpeg2video", configure=configure, prepare=prepare, rate=25)


def test_an_interlaced_video_is_refused(tmp_path: Path) -> None:
    assert "the video is interlaced - deinterlace it first" in refused(interlaced(tmp_path / "x.m2ts"))


def big(path: Path) -> Path:
    return write_video(path, [np.zeros((4320, 7680, 3), np.uint8)] * 2, codec="mpeg4")


def test_8k_is_refused_before_it_is_decoded(tmp_path: Path) -> None:
    message = refused(big(tmp_path / "x.mp4"))
    assert "7680 x 4320" in message
    assert "as 4K or smaller" in message


def still_as_video(path: Path) -> Path:
    Image.fromarray(WALK[0]).save(path, "JPEG")
    return path


def one_frame(path: Path) -> Path:
    return write_video(path, WALK[:1])


def empty(path: Path) -> Path:
    path.write_bytes(b"")
    return path


def text(path: Path) -> Path:
    path.write_text("#EXTM3U\n#EXTINF:1,\nfile:///etc/passwd\n")
    return path


def encrypted(path: Path) -> Path:
    options = {
        "encryption_scheme": "cenc-aes-ctr",
        "encryption_key": "76a6c65c5ea762046bd749a2e632ccbb",
        "encryption_kid": "a7e61c373e219033c21091fa607bf3b8",
    }
    return write_video(path, WALK, container_options=options)


def encrypted_by_another(path: Path) -> Path:
    """Of a codec that decoders then do not know."""
    data = bytearray(write_video(path, WALK).read_bytes())
    place = data.index(b"avc1", data.index(b"stsd"))
    data[place : place + 4] = b"encv"
    path.write_bytes(bytes(data) + b"\0\0\0\x10schmcenc\0\0\0\0")
    return path


def of_no_known_codec(path: Path) -> Path:
    data = bytearray(write_video(path, WALK).read_bytes())
    place = data.index(b"avc1", data.index(b"stsd"))
    data[place : place + 4] = b"zzzz"
    path.write_bytes(data)
    return path


def all_around(path: Path) -> Path:
    data = write_video(path, WALK).read_bytes()
    path.write_bytes(data + b"\0\0\0\x31uuid<rdf><GSpherical:Spherical>true</GSpherical:Spherical>")
    return path


def half_depth(path: Path) -> Path:
    data = write_video(path, WALK).read_bytes()
    path.write_bytes(data + b'{"intrinsicMatrix":[1,0,0,0,1,0,1,1,1],"rangeOfEncodedDepth":[0,3]}')
    return path


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (encrypted_by_another, "encrypted"),
        (of_no_known_codec, "codec is not known"),
        (all_around, "360° video, which is not supported - export a flat video"),
        (half_depth, "Record3D's video, half of which is depth - export EXR + RGB"),
        (still_as_video, "is a photograph, not a video"),
        (one_frame, "no frames"),
        (empty, "empty"),
        (text, "not read"),
        (encrypted, "encrypted"),
    ],
)
def test_what_is_no_usable_video_is_refused_in_one_line(
    tmp_path: Path, make: Callable[[Path], Path], words: str
) -> None:
    assert words in refused(make(tmp_path / "x.mp4"))


def test_a_video_with_a_photographs_name_is_refused(tmp_path: Path) -> None:
    for number in (1, 2):
        write_video(tmp_path / "x.mp4", WALK[number:]).rename(tmp_path / f"{number}.jpg")
    assert "1.jpg: is a video with a photograph's name - name it .mp4" in refused(tmp_path)


def test_a_video_a_folder_of_them_and_a_zip_are_captures(tmp_path: Path) -> None:
    (tmp_path / "rooms").mkdir()
    first = write_video(tmp_path / "rooms" / "a.mp4", WALK)
    write_video(tmp_path / "rooms" / "b.mov", WALK[::-1])
    Image.fromarray(WALK[0]).save(tmp_path / "rooms" / "c.jpg")
    archive = write_zip(tmp_path / "x.zip", {f"r/{file.name}": file.read_bytes() for file in first.parent.iterdir()})
    for path, photographs, videos in ((first, 0, 1), (tmp_path / "rooms", 1, 2), (archive, 1, 2)):
        found = inspect_capture(path)
        assert (found.format, found.views, found.videos) == ("sfm", photographs, videos)
        assert found.seconds == pytest.approx(2.0 * videos, abs=0.3)
        assert found.source == path
        assert len(write_thumbnails(path, tmp_path / "small", count=3, size=64)) == 3


def test_a_refusal_names_what_the_user_gave(tmp_path: Path) -> None:
    """And not the temporary folder that frames and zips are unpacked into."""
    blank = [np.full((HEIGHT, WIDTH, 3), 90, np.uint8)] * RATE * 2
    video = write_video(tmp_path / "x.mp4", blank)
    archive = write_zip(tmp_path / "x.zip", {"1.png": b"\x89PNG\r\n\x1a\n", "2.png": b""})
    for path in (video, archive):
        with pytest.raises(InputError) as error:
            read_capture(path, max_size=None)
        assert str(error.value).startswith(str(path))
        assert "cvdgs-" not in str(error.value)


def test_a_warning_names_what_the_user_gave(tmp_path: Path) -> None:
    capture = write_transforms(tmp_path / "cap", shots(3))
    (capture / "images" / "0003.png").unlink()
    archive = Path(shutil.make_archive(str(tmp_path / "x"), "zip", tmp_path, "cap"))
    for found in (inspect_capture(archive), read_capture(archive, max_size=None)):
        (message,) = (warning.message for warning in found.warnings if warning.name == "missing-images")
        assert message.startswith(f"{archive}/cap/transforms.json: 1 of 3 images are missing in {archive}/cap and")
        assert not any("cvdgs-" in warning.message for warning in found.warnings)


@pytest.mark.slow
@pytest.mark.skipif(peak_memory_mb() is None, reason="this system does not tell a process's peak")
def test_memory_grows_with_the_points_that_are_followed_in_a_video_and_not_with_its_frames(tmp_path: Path) -> None:
    """A second of these small pictures would be 2.8 MiB; of 4K it would be a hundred times that."""
    peaks = []
    for seconds in (20, 300):
        walk = (window(WALL, 50 + (4 * step) % 500) for step in range(RATE * seconds))
        peaks.append(peak_of_use(write_video(tmp_path / f"{seconds}.mp4", list(walk)), tmp_path / str(seconds)))
    assert peaks[1] - peaks[0] < 0.4 * (300 - 20)


@pytest.mark.slow
@pytest.mark.skipif(peak_memory_mb() is None, reason="this system does not tell a process's peak")
def test_of_an_hdr_video_no_pictures_are_kept_to_find_its_white(tmp_path: Path) -> None:
    """One is looked at every two seconds, which is 0.7 MiB."""

    def configure(stream: av.VideoStream) -> None:
        stream.options = {"crf": "14", "preset": "ultrafast", "x264-params": "transfer=arib-std-b67"}

    peaks = []
    for count in (20, 120):
        walk = [window(WALL, 50 + (4 * step) % 80) for step in range(count)]
        times = [1260 * step for step in range(count)]
        path = write_video(tmp_path / f"{count}.mp4", walk, configure=configure, times=times)
        peaks.append(peak_of_use(path, tmp_path / str(count)))
    assert look_through(tmp_path / "20.mp4").transfer == "hlg"
    assert peaks[1] - peaks[0] < 0.3 * (120 - 20)


def peak_of_use(path: Path, out: Path) -> int:
    """MiB of a process that makes photographs of a video."""
    script = """
import sys
from pathlib import Path
from cvdgs.core.runtime.resources import peak_memory_mb
from cvdgs.core.intake.video import look_through, extract
from cvdgs.core.intake.selection import choose
look = look_through(Path(sys.argv[1]))
(chosen,) = choose([look.film])
extract(look, chosen, Path(sys.argv[2]), look.white)
print(peak_memory_mb())
"""
    command = [sys.executable, "-c", script, str(path), str(out)]
    return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
