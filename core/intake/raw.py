"""Raw files of cameras (DNG, CR2, CR3, NEF, ARW), developed by LibRaw to sRGB: all of a capture in the same way.

A camera's own white balance and exposure change from photograph to photograph, and a scene that is seen through them
has a thread in another colour from every side.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .exif import LENS_ATTRIBUTES, exif_of_lens, taken_with
from .kinds import kind_of_file
from .sampling import evenly_spread

_SAMPLES = 5  # photographs that the common development is measured on
_BRIGHT = 0.99  # of the pixels are darker than what becomes `_BRIGHT_LIGHT`
_BRIGHT_LIGHT = 0.8  # of white; photographs that a camera developed have about that
_GAINS = (1.0, 4.0)
_SRGB_CURVE = (2.4, 12.92)  # as LibRaw gives a curve: its exponent and its slope at black
_COPY_AGAIN = "copy it again, or export TIFF"
_REMEDY = "convert it to DNG or TIFF first"


@dataclass(frozen=True)
class Development:
    """How raw files become pictures.

    Attributes:
        white_balance: factors of the sensor's red, green, blue and second green.
        gain: of the light after that.
    """

    white_balance: tuple[float, float, float, float]
    gain: float

    @classmethod
    def common(cls, photographs: Sequence[Path]) -> Development | None:
        """One for all raw files among the photographs, or None where there are none that can be read.

        The white balance is the median of what the camera chose, the gain what brings the photographs together to the
        brightness that cameras give theirs. What cannot be read is left to those who read it.
        """
        raws = [path for path in photographs if _is_raw(path)]
        if not raws:
            return None
        samples = evenly_spread(raws, _SAMPLES)
        balances: list[list[float]] = []
        for path in samples:
            with suppress(InputError), _opened(path) as raw:
                balances.append(_white_balance(raw))
        if not balances:
            return None
        balance = tuple(float(value) for value in np.median(balances, axis=0))
        lights: list[float] = []
        for path in samples:
            with suppress(InputError):
                lights.append(_bright_light(path, balance))
        if not lights:
            return None
        gain = float(np.clip(_BRIGHT_LIGHT / max(float(np.median(lights)), 1e-3), *_GAINS))
        return cls(balance, gain)  # type: ignore[arg-type]


@dataclass(frozen=True)
class RawHeader:
    """Size of the developed picture, upright, and what it was taken with."""

    width: int
    height: int
    taken_with: str


def read_raw_header(path: Path) -> RawHeader:
    """What the file says of itself, without its pixels.

    Raises:
        InputError: damaged, of a camera that LibRaw does not know, or a package is missing.
    """
    with _opened(path) as raw:
        sizes = raw.sizes
        width, height = sizes.iwidth, sizes.iheight
        if sizes.flip in (5, 6):
            width, height = height, width
        return RawHeader(int(width), int(height), taken_with(exif_of_raw(path)))


def exif_of_raw(path: Path) -> bytes:
    """Raw EXIF data that say what it was taken with, of CR3 the focal length alone; nothing where it is unreadable."""
    import OpenImageIO as oiio  # reads the TIFF tags of all but CR3

    if path.suffix.lower() == ".cr3":
        with suppress(InputError), _opened(path) as raw:
            return exif_of_lens("", "", float(raw.other.focal_length), 0.0, 0.0)
        return b""
    file = oiio.ImageInput.open(str(path))
    if file is None:
        oiio.geterror()
        return b""
    try:
        spec = file.spec()
        make, model = (spec.get_string_attribute(name) for name in ("Make", "Model"))
        return exif_of_lens(make, model, *(spec.get_float_attribute(name, 0.0) for name in LENS_ATTRIBUTES))
    except UnicodeDecodeError:
        return b""
    finally:
        file.close()


def read_raw(path: Path, development: Development | None = None) -> NDArray[np.uint8]:
    """(H, W, 3) sRGB, upright; without a `development` the file gets one of its own.

    Raises:
        InputError: as for `read_raw_header`.
    """
    chosen = development or Development.common([path])
    if chosen is None:
        with _opened(path):  # which says what is wrong with the header, as a rule
            raise InputError("the raw file is damaged or cut short", where=path, remedy=_COPY_AGAIN)
    return _develop(path, chosen)


def _is_raw(path: Path) -> bool:
    with suppress(InputError):
        return kind_of_file(path) == "raw"
    return False


def _develop(path: Path, development: Development, **options: Any) -> NDArray[np.uint8]:
    import rawpy

    with _opened(path) as raw:
        picture = raw.postprocess(
            user_wb=list(development.white_balance),
            bright=development.gain,
            no_auto_bright=True,
            output_color=rawpy.ColorSpace.sRGB,
            output_bps=8,
            highlight_mode=rawpy.HighlightMode.Clip,
            **{"gamma": _SRGB_CURVE, **options},
        )
    if picture.ndim != 3 or picture.shape[2] != 3:
        raise InputError("the raw file is not one of colours", where=path, remedy=_REMEDY)
    return picture


def _bright_light(path: Path, balance: tuple[float, ...]) -> float:
    """How much of white the brighter pixels have, of light."""
    picture = _develop(path, Development(balance, 1.0), half_size=True, gamma=(1.0, 1.0))  # type: ignore[arg-type]
    return float(np.quantile(picture.max(axis=2), _BRIGHT)) / 255.0


def _white_balance(raw: Any) -> list[float]:
    """What the camera chose, else daylight; relative to green."""
    for candidate in (raw.camera_whitebalance, raw.daylight_whitebalance):
        values = np.array(candidate, np.float64)
        if len(values) == 4 and np.isfinite(values).all() and (values[:3] > 0.0).all():
            values[3] = values[3] if values[3] > 0.0 else values[1]
            return list(values / values[1])
    return [1.0, 1.0, 1.0, 1.0]


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    try:
        import rawpy
    except ImportError:
        remedy = "install rawpy (run.py --doctor says how), or export JPEG"
        raise InputError("raw photographs need the package rawpy", where=path, remedy=remedy) from None
    try:
        with rawpy.imread(str(path)) as raw:
            yield raw
    except rawpy.LibRawFileUnsupportedError:
        what = "LibRaw does not know this camera, or it is no raw file"
        raise InputError(what, where=path, remedy=_REMEDY) from None
    except (rawpy.LibRawError, ValueError, OSError, RuntimeError):
        raise InputError("the raw file is damaged or cut short", where=path, remedy=_COPY_AGAIN) from None
