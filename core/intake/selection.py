"""Which frames of videos become photographs: by how the picture moves, and of those that see the same the sharpest.

Cameras are found from neighbours that share half of what they show; a scene wants more. Held-out frames lost most where
neighbours shared less than three quarters, and some where parallax was larger than a few pixels. docs/faq.md has what
was measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from .motion import Followed, Motion, motion_between
from .sampling import MOST_FRAMES, evenly_spread

# What makes a frame worth having since the last one: a share of the picture has moved on or is lost from sight, or the
# camera has moved enough for depths to be seen, in longer sides of the picture.
_SHIFT = 0.1
_LOST = 0.25
_PARALLAX_PIXELS = 3.0  # of the pictures that the scene is fitted to
_PARALLAX = (0.006, 0.009)  # least and most that these are: half the step, which took 110 frames for 78, gained nothing
_EARLIEST, _LATEST = 0.7, 1.25  # of what is due: among the frames between these the sharpest is taken
_START = 0.3
_BLIND_SECONDS = 0.5  # between frames where no motion can be measured
_FINER = 0.5  # as often as that at most, in a video with little movement
_FEW = 24
_ATTEMPTS = 12


@dataclass(frozen=True)
class Frame:
    """One frame as it was seen while a video was looked through.

    Attributes:
        number: in order of the video.
        time: in seconds.
        sharpness: larger is sharper; compares frames that see the same.
        probe: the place in `Film.probes` of the points that are nearest to it in time.
    """

    number: int
    time: float
    sharpness: float
    probe: int


@dataclass(frozen=True)
class Film:
    """A video that was looked through: all its frames, and the points of some of them."""

    frames: Sequence[Frame]
    probes: Sequence[Followed]


def choose(films: Sequence[Film], most: int = MOST_FRAMES, size: int | None = None) -> list[list[Frame]]:
    """The frames to take of each film, in order; of all together not more than `most`.

    The same measure decides in all of them, and is made coarser until they are few enough.

    Args:
        films: all of a capture.
        most: frames.
        size: longer side in pixels of the pictures that the scene is fitted to, as far as it is known: small ones, as
            of a draft, need fewer.
    """
    parallax = parallax_of(size)
    spacing = 1.0
    for _ in range(_ATTEMPTS):
        chosen = [_walk(film, spacing, parallax) for film in films]
        count = sum(map(len, chosen))
        if count <= most:
            break
        spacing *= max(1.05, count / most)
    else:
        chosen = [_thinned(frames, count, most) for frames in chosen]
    if count < _FEW and spacing == 1.0:
        finer = [_walk(film, _FINER, parallax) for film in films]
        if sum(map(len, finer)) <= most:
            return finer
    return chosen


def parallax_of(size: int | None) -> float:
    """The parallax between neighbours, in longer sides, that suits pictures of `size` pixels; the least for None."""
    least, most = _PARALLAX
    return least if size is None else min(max(_PARALLAX_PIXELS / size, least), most)


def worth(motion: Motion | None, seconds: float, parallax: float) -> float:
    """How much a second frame adds to a first, so many seconds later; from 1 on it is worth being a photograph.

    Args:
        motion: between them.
        seconds: likewise.
        parallax: that is worth one, in longer sides.
    """
    if motion is None:
        return seconds / _BLIND_SECONDS
    return max(motion.shift / _SHIFT, motion.parallax / parallax, motion.lost / _LOST)


def _walk(film: Film, spacing: float, parallax: float) -> list[Frame]:
    """The sharpest frame wherever one is due since the last one."""
    if not film.frames:
        return []
    by_probe: list[list[Frame]] = [[] for _ in film.probes]
    for frame in film.frames:
        by_probe[frame.probe].append(frame)
    chosen = [_first(film, by_probe, spacing, parallax)]
    while True:
        last = chosen[-1].probe
        candidates: list[Frame] = []
        due = False
        for probe in range(last + 1, len(film.probes)):
            value = _worth(film, by_probe, last, probe, parallax) / spacing
            if value >= _LATEST and due:
                break
            if value >= _EARLIEST:
                candidates += by_probe[probe]
            due |= value >= 1.0
            if value >= _LATEST:
                break
        if not due or not candidates:
            return chosen
        chosen.append(max(candidates, key=lambda frame: frame.sharpness))


def _worth(film: Film, by_probe: Sequence[Sequence[Frame]], first: int, second: int, parallax: float) -> float:
    seconds = by_probe[second][0].time - by_probe[first][0].time
    return worth(motion_between(film.probes[first], film.probes[second]), seconds, parallax)


def _first(film: Film, by_probe: Sequence[Sequence[Frame]], spacing: float, parallax: float) -> Frame:
    """The sharpest before anything has moved much."""
    candidates: list[Frame] = []
    for probe, frames in enumerate(by_probe):
        if candidates and _worth(film, by_probe, 0, probe, parallax) > _START * spacing:
            break
        candidates += frames
    return max(candidates, key=lambda frame: frame.sharpness)


def _thinned(frames: list[Frame], count: int, most: int) -> list[Frame]:
    keep = max(1, len(frames) * most // count)
    return evenly_spread(frames, keep)
