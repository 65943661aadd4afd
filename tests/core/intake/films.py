"""Small videos and photographs of telephones' formats, made by the libraries that read them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import av
import numpy as np

WIDTH, HEIGHT, RATE = 320, 192, 15


def wall(seed: int = 0, side: int = 900) -> np.ndarray:
    """A large picture with something to follow everywhere."""
    from scipy.ndimage import gaussian_filter

    noise = np.random.default_rng(seed).random((side, side, 3))
    smooth = gaussian_filter(noise, (3, 3, 0))
    smooth = (smooth - smooth.min()) / (smooth.max() - smooth.min())
    return (smooth * 255).astype(np.uint8)


def window(picture: np.ndarray, x: float, y: float = 100.0) -> np.ndarray:
    """What a camera in front of `picture` sees at a whole pixel."""
    left, top = round(x), round(y)
    return np.ascontiguousarray(picture[top : top + HEIGHT, left : left + WIDTH])


def write_video(
    path: Path,
    frames: Sequence[np.ndarray],
    *,
    codec: str = "libx264",
    pixel_format: str = "yuv420p",
    rate: int = RATE,
    prepare: Callable[[av.VideoFrame], None] = lambda _: None,
    configure: Callable[[av.VideoStream], None] = lambda _: None,
    times: Sequence[int] | None = None,
    container_options: dict[str, str] | None = None,
) -> Path:
    """A video of (H, W, 3) uint8 frames; `times` are in units of 1/600 s."""
    with av.open(str(path), "w", container_options=container_options or {}) as container:
        stream = container.add_stream(codec, rate=rate)
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = pixel_format
        if codec == "libx264":
            stream.options = {"crf": "14", "preset": "ultrafast", "g": "15"}
        if times is not None:
            from fractions import Fraction

            stream.codec_context.time_base = Fraction(1, 600)
        configure(stream)
        for number, pixels in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(pixels, format="rgb24").reformat(format=pixel_format)
            frame.pts = number if times is None else times[number]
            prepare(frame)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def planes_frame(luma: int, blue: int, red: int, pixel_format: str, width: int = 64, height: int = 64) -> av.VideoFrame:
    """A frame of one Y'CbCr colour, codes as they are."""
    frame = av.VideoFrame(width, height, pixel_format)
    kind = np.uint16 if pixel_format.endswith("le") else np.uint8
    for plane, code in zip(frame.planes, (luma, blue, red), strict=True):
        rows = plane.line_size // np.dtype(kind).itemsize
        plane.update(np.full((plane.height, rows), code, kind).tobytes())
    return frame
