"""The largest files that the readers take: read within the memory that docs/trust.md states. Linux tells the peak."""

from __future__ import annotations

import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from cvdgs.core.capture.images import MAX_DECODED_BYTES
from cvdgs.core.capture.source import MOST_VIEWS

from . import examples

PEAK_BYTES = 3 << 30
"""Of resident memory, with Python, torch and the other libraries (0.3 GiB) and with the pages of a mapped file."""
_OBSERVATION_BYTES = 24  # of an image in images.bin

_CHILD = """
import sys
from pathlib import Path
from cvdgs.core.capture.colmap_files import read_model
from cvdgs.core.capture.images import read_pixels
from cvdgs.core.enhance.gan.weights import load_generator
from cvdgs.core.runtime.resources import peak_memory_mb
{0}(Path(sys.argv[1]))
print(peak_memory_mb())
"""


def _long_file(path: Path, head: bytes, size: int) -> Path:
    """A file that begins with `head` and has zeros up to `size`, which take no room on the disk."""
    with open(path, "wb") as file:
        file.write(head)
        file.truncate(size)
    return path


def eight_bit_photograph(folder: Path) -> Path:
    """TGA with four channels."""
    side = int((MAX_DECODED_BYTES / 4) ** 0.5)
    head = struct.pack("<BBBHHBHHHHBB", 0, 0, 2, 0, 0, 0, 0, 0, side, side, 32, 8)
    return _long_file(folder / "photograph.tga", head, len(head) + 4 * side * side)


def floating_point_photograph(folder: Path) -> Path:
    side = int((MAX_DECODED_BYTES / 12) ** 0.5)
    head = b"PF\n%d %d\n-1.0\n" % (side, side)
    return _long_file(folder / "photograph.ppm", head, len(head) + 12 * side * side)


def _colmap_model(folder: Path) -> Path:
    for name, content in examples.colmap_files(text=False).items():
        (folder / name).write_bytes(content)
    return folder


def colmap_images(folder: Path) -> Path:
    """4 GiB: as many images as a model may have, with names of 4,000 characters."""
    room = (4 << 30) // MOST_VIEWS - 5000
    observations = room // _OBSERVATION_BYTES
    with open(_colmap_model(folder) / "images.bin", "wb") as file:
        file.write(struct.pack("<Q", MOST_VIEWS))
        for number in range(MOST_VIEWS):
            name = f"{number:04000d}".encode() + b"\0"
            file.write(struct.pack("<I7dI", number, 1, 0, 0, 0, 0, 0, 0, 1) + name + struct.pack("<Q", observations))
            file.seek(_OBSERVATION_BYTES * observations, 1)
        file.truncate(file.tell())
    return folder


def colmap_points(folder: Path) -> Path:
    """1 GiB of points that two images see."""
    record = struct.pack("<Q3d3BdQ", 1, 1.0, 2.0, 3.0, 4, 5, 6, 0.5, 2) + bytes(16)
    count = ((1 << 30) - 8) // len(record)
    block = 1 << 16
    with open(_colmap_model(folder) / "points3D.bin", "wb") as file:
        file.write(struct.pack("<Q", count))
        for start in range(0, count, block):
            file.write(record * min(block, count - start))
    return folder


def weights(folder: Path) -> Path:
    """A network that just fits into the 16 MiB that its file may have."""
    from cvdgs.core.enhance.gan.networks import Generator, GeneratorConfig
    from cvdgs.core.enhance.gan.weights import save_generator

    save_generator(Generator(GeneratorConfig(widths=(200,) * 4)), folder / "weights.safetensors")
    assert 14 << 20 < (folder / "weights.safetensors").stat().st_size <= 16 << 20
    return folder / "weights.safetensors"


LARGEST: dict[str, tuple[str, Callable[[Path], Path]]] = {
    "eight-bit-photograph": ("read_pixels", eight_bit_photograph),
    "floating-point-photograph": ("read_pixels", floating_point_photograph),
    "colmap-images": ("read_model", colmap_images),
    "colmap-points": ("read_model", colmap_points),
    "weights": ("load_generator", weights),
}


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the peak is read from Linux' /proc")
@pytest.mark.parametrize(("reader", "make"), LARGEST.values(), ids=LARGEST)
def test_the_largest_file_does_not_take_more_memory_than_stated(
    tmp_path: Path, reader: str, make: Callable[[Path], Path]
) -> None:
    command = [sys.executable, "-c", _CHILD.format(reader), str(make(tmp_path))]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    print(f"peak: {int(result.stdout):,} MiB")
    assert int(result.stdout) << 20 < PEAK_BYTES
