"""Videos as photographs: looked through once for sharpness and motion, then the chosen frames written as JPEG.

Frames are decoded one after another, so a video of any length takes the memory of a few frames. Sound is not looked at.
Pixels that are not square (DV, HDV, anamorphic lenses) are made square, and nothing is enlarged by that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..color.hdr import brightness_of, white_of
from ..errors import InputError
from ..files.images import write_jpeg
from ..files.untrusted import opened
from ..runtime.resources import available_processors
from ..runtime.threads import one_thread
from .kinds import MAX_VIDEO_BYTES, is_plain_image, kind_of
from .motion import WIDTH, Followed, Follower
from .panoramas import refuse_composed_video
from .selection import Film, Frame
from .video_color import frame_colors, is_log, small_light, square_size, transfer_of

MAX_PIXELS = 18_000_000
"""Of a frame: 5.3K of action cameras, not 8K, whose decoder would take gigabytes."""
MAX_SECONDS = 3600.0

_DEMUXERS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts"
_LEAST_FRAMES = 2
_LEAST_SIDE = 64
_PROBES_A_SECOND = 10.0  # in which points are followed
_LIGHT_SECONDS = 2.0  # between the frames that the white of HDR is taken from
_SHARPNESS_SCALE = 2  # of the picture that sharpness is measured in, to that in which points are followed
_MOST_DAMAGED = 200  # packets in a row
_CUT = 0.95  # of the stated length; what ends before it was cut
_SEEK_SECONDS = 3.0  # over a longer gap than this it is quicker to seek
_SAME_TIME = 1e-4  # seconds
_QUALITY = 95
_MOST_THREADS = 4  # each holds frames
_INTERLACED_FRAMES = 30
_REMEDY = "export it again as MP4 (H.264)"


@dataclass(frozen=True)
class Look:
    """A video that was looked through.

    Attributes:
        path: the file.
        film: its frames and how they move.
        is_shortened: whether it goes on after `MAX_SECONDS`, where it is not looked at.
        cut_at: seconds at which it breaks off, or None.
        transfer: "hlg", "pq" or "" (not HDR).
        white: of HDR, in cd/m², see `color.hdr.white_of`.
        is_log: whether it seems to be log video.
    """

    path: Path
    film: Film
    is_shortened: bool
    cut_at: float | None
    transfer: str
    white: float
    is_log: bool = False


@dataclass(frozen=True)
class VideoHeader:
    """Size upright in square pixels, and the stated length."""

    width: int
    height: int
    seconds: float


def read_video_header(path: Path) -> VideoHeader:
    """What a video says of itself, and that its first frame can be decoded.

    Raises:
        InputError: it is no video that can be used.
    """
    with _opened(path) as (container, stream):
        frame = next(_frames(container, stream, path), None)
        if frame is None:
            raise _no_frames(path)
        width, height = square_size(frame.width, frame.height, _pixel_aspect(stream))
        width, height = (height, width) if frame.rotation % 180 else (width, height)
        return VideoHeader(width, height, _stated_seconds(container, stream))


def some_frames(path: Path, count: int) -> Iterator[NDArray[np.uint8]]:
    """(H, W, 3) sRGB frames from all over a video, for thumbnails; fewer than `count` where it cannot be searched.

    Raises:
        InputError: it is no video that can be used.
    """
    with _opened(path) as (container, stream):
        seconds = _stated_seconds(container, stream)
        for index in range(count):
            if index and stream.time_base:
                container.seek(int(index / count * seconds / float(stream.time_base)), stream=stream)
            frame = next(_frames(container, stream, path), None)
            if frame is None:
                return
            yield frame_colors(frame, aspect=_pixel_aspect(stream))


def look_through(path: Path, progress: Callable[[float], None] = lambda _: None) -> Look:
    """Measure every frame of a video.

    Raises:
        InputError: it is no video that can be used.
    """
    frames: list[Frame] = []
    probes: list[Followed] = []
    bright: list[float] = []
    follower, next_probe, next_light, transfer, time, start = Follower(), 0.0, 0.0, "", 0.0, 0.0
    is_shortened = seems_log = False
    with _opened(path) as (container, stream), one_thread():
        stated = min(_stated_seconds(container, stream), MAX_SECONDS)
        # What is computed for one small picture is over before more threads have begun; the decoder needs them.
        for number, (time, frame) in enumerate(_timed(container, stream, path)):
            if number < _INTERLACED_FRAMES and frame.interlaced_frame:
                raise InputError("the video is interlaced", where=path, remedy="deinterlace it first")
            if not number:
                start = time
                transfer, seems_log = transfer_of(frame), is_log(frame)
                next_probe = next_light = time
            if time - start > MAX_SECONDS:
                is_shortened = True
                break
            large, small = _greys(frame, _pixel_aspect(stream))
            if time >= next_probe:
                probes.append(follower.advance(small))
                next_probe = max(next_probe + 1.0 / _PROBES_A_SECOND, time)
            if time >= next_light and (light := small_light(frame)) is not None:
                bright.append(brightness_of(light))
                next_light = time + _LIGHT_SECONDS
            frames.append(Frame(number, time, _sharpness(large), len(probes) - 1))
            if stated:
                progress(min((time - start) / stated, 1.0))
    if len(frames) < _LEAST_FRAMES:
        raise _no_frames(path)
    seconds = frames[-1].time - frames[0].time
    is_cut = stated and seconds < _CUT * stated - 0.5 and not is_shortened
    cut_at = seconds if is_cut else None
    return Look(path, Film(frames, probes), is_shortened, cut_at, transfer, white_of(bright), seems_log)


def extract(
    look: Look,
    chosen: Sequence[Frame],
    folder: Path,
    white: float,
    progress: Callable[[float], None] = lambda _: None,
) -> list[tuple[str, float]]:
    """Write the frames `chosen` of a video into the folder, upright and in sRGB; returns names and times in seconds.

    Args:
        white: of HDR, the same for all videos of a capture.

    Raises:
        InputError: the video cannot be decoded any more.
        OSError: a frame cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written: list[tuple[str, float]] = []
    with _opened(look.path) as (container, stream), one_thread():  # more wait for each other, and for the decoder's
        for frame, wanted in _found(container, stream, look, chosen):
            name = f"{wanted.number:06d}.jpg"
            write_jpeg(folder / name, frame_colors(frame, white, _pixel_aspect(stream)), _QUALITY)
            written.append((name, wanted.time))
            progress(len(written) / len(chosen))
    return written


def _found(container: Any, stream: Any, look: Look, chosen: Sequence[Frame]) -> Iterator[tuple[Any, Frame]]:
    """The decoded frames that are `chosen`; long gaps between them are jumped over."""
    source, position = _timed(container, stream, look.path), look.film.frames[0].time
    can_seek = stream.time_base is not None
    for wanted in chosen:
        if can_seek and wanted.time - position > _SEEK_SECONDS:
            container.seek(int(wanted.time / float(stream.time_base)), stream=stream)
            source = _timed(container, stream, look.path)
            landed = next(source, None)
            # A file without an index may land anywhere: then it is read on from its beginning.
            can_seek = landed is not None and landed[1].time is not None and landed[0] <= wanted.time + _SAME_TIME
            if landed is not None and can_seek:
                source = chain([landed], source)
            else:
                container.seek(0)
                source = _timed(container, stream, look.path)
        frame = next((frame for time, frame in source if time >= wanted.time - _SAME_TIME), None)
        if frame is None:
            return
        position = wanted.time
        yield frame, wanted


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """The container and its video stream, ready to be decoded."""
    try:
        import av
    except ImportError:
        remedy = "install av (run.py --doctor says how), or export the video's frames as JPEG"
        raise InputError("videos need the package av (PyAV)", where=path, remedy=remedy) from None
    with opened(path, most_bytes=MAX_VIDEO_BYTES) as file:
        start = file.read(32)
    if not start:
        raise InputError("the file is empty", where=path, remedy="copy it again")
    if is_plain_image(start) or kind_of(start, path.name) in ("heif", "avif", "raw"):
        raise InputError("is a photograph, not a video", where=path, remedy="rename it, or remove it")
    refuse_composed_video(path)
    av.logging.set_level(None)
    try:
        container = av.open(
            str(path.resolve()),
            # Playlists would open other files, and addresses.
            options={"format_whitelist": _DEMUXERS, "protocol_whitelist": "file"},
        )
    except av.error.FFmpegError:
        what = "the video is damaged, cut short, or of a format that is not read"
        raise InputError(what, where=path, remedy=_REMEDY) from None
    try:
        yield container, _stream(container, path)
    except av.error.FFmpegError as error:
        raise InputError(f"the video is damaged ({error.strerror})", where=path, remedy=_REMEDY) from None
    finally:
        container.close()


def _stream(container: Any, path: Path) -> Any:
    """The stream of pictures; refuses what cannot be decoded in the memory there is."""
    streams = [stream for stream in container.streams.video if not stream.disposition & _ATTACHED_PICTURE]
    if not streams:
        raise InputError("the file has no pictures, only sound or data", where=path, remedy="give a video")
    known = [stream.codec_context for stream in streams if stream.codec_context is not None]
    if _is_encrypted(path, known):
        raise InputError("the video is encrypted", where=path, remedy="export it without copy protection")
    if not known:
        raise InputError("the video's codec is not known", where=path, remedy=_REMEDY)
    context = max(known, key=lambda candidate: (candidate.width or 0) * (candidate.height or 0))
    stream = next(stream for stream in streams if stream.codec_context is context)
    width, height = context.width, context.height
    size = f"the video is {width} x {height} pixels"
    if width * height > MAX_PIXELS:
        raise InputError(f"{size}, more than is decoded", where=path, remedy="export it as 4K or smaller")
    if min(square_size(width, height, _pixel_aspect(stream))) < _LEAST_SIDE:
        raise InputError(f"{size}, too small", where=path, remedy="give a larger one")
    context.options = {"max_pixels": str(MAX_PIXELS)}
    context.thread_type = "AUTO"
    context.thread_count = min(available_processors(), _MOST_THREADS)
    return stream


def _pixel_aspect(stream: Any) -> float:
    """Width of a pixel by its height; 1 where the file does not say."""
    aspect = stream.sample_aspect_ratio
    return float(aspect) if aspect and aspect > 0 else 1.0


_ATTACHED_PICTURE = 1 << 10  # AV_DISPOSITION_ATTACHED_PIC: the cover of a song
_ENCRYPTED_TAG = b"encv"
_MOVIE_BYTES = 8 << 20


def _is_encrypted(path: Path, contexts: Sequence[Any]) -> bool:
    """Whether the samples of an MP4 are (ISO/IEC 23001-7): decoders take them for noise."""
    if any(str(context.codec_tag).lower() == _ENCRYPTED_TAG.decode() for context in contexts):
        return True
    size = path.stat().st_size
    with open(path, "rb") as file:
        start = file.read(_MOVIE_BYTES)
        file.seek(max(0, size - _MOVIE_BYTES))
        end = file.read(_MOVIE_BYTES)
    # The description of the samples stands at the file's beginning or end.
    return any(_ENCRYPTED_TAG in part[part.find(b"stsd") :] and b"schm" in part for part in (start, end))


def _frames(container: Any, stream: Any, path: Path) -> Iterator[Any]:
    """What can be decoded; damaged packets are passed over."""
    import av

    damaged = 0
    packets = container.demux(stream)
    while damaged < _MOST_DAMAGED:
        try:
            packet = next(packets)
        except (StopIteration, av.error.FFmpegError):
            return
        try:
            decoded = packet.decode()
        except av.error.FFmpegError:
            damaged += 1
            continue
        for frame in decoded:
            if frame.width * frame.height > MAX_PIXELS:
                raise InputError("the video's size changes to more than is decoded", where=path, remedy=_REMEDY)
            if not frame.is_corrupt:
                damaged = 0
                yield frame


def _timed(container: Any, stream: Any, path: Path) -> Iterator[tuple[float, Any]]:
    """The frames with their times in seconds; where they have none, the numbers from here on stand for them."""
    for number, frame in enumerate(_frames(container, stream, path)):
        if frame.time is not None:
            yield float(frame.time), frame
        else:
            yield number / float(stream.average_rate or 30), frame


def _greys(frame: Any, aspect: float) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The picture in grey in two sizes, for sharpness and for motion."""
    size = square_size(frame.width, frame.height, aspect)
    scale = _SHARPNESS_SCALE * WIDTH / max(size)
    width, height = (max(16, 4 * round(side * scale / 4)) for side in size)
    large = frame.reformat(width=width, height=height, format="gray", interpolation="AREA").to_ndarray()
    pairs = large[: height // 2 * 2, : width // 2 * 2].astype(np.uint16)
    small = (pairs[::2, ::2] + pairs[1::2, ::2] + pairs[::2, 1::2] + pairs[1::2, 1::2] + 2) >> 2
    return large, small.astype(np.uint8)


def _sharpness(grey: NDArray[np.uint8]) -> float:
    """Variance of the Laplacian (Pech-Pacheco et al. 2000)."""
    values = grey.astype(np.int16)
    middle = values[1:-1, 1:-1]
    laplacian = values[:-2, 1:-1] + values[2:, 1:-1] + values[1:-1, :-2] + values[1:-1, 2:] - 4 * middle
    return float(laplacian.var())


def _stated_seconds(container: Any, stream: Any) -> float:
    if stream.duration and stream.time_base:
        return float(stream.duration * stream.time_base)
    return float(container.duration or 0) / 1e6


def _no_frames(path: Path) -> InputError:
    return InputError("the video has no frames that can be decoded", where=path, remedy="copy or export it again")
