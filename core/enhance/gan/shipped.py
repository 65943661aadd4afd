"""The shipped weights, and whether they are the very file that was published: its SHA-256 stands beside it."""

from __future__ import annotations

import hashlib
from pathlib import Path

from ...errors import InputError
from .generator import Generator
from .weights import SHIPPED, load_generator

_REMEDY = "install cvdgs again, or give your own weights as a file: --enhancer FILE.safetensors"


def checksum_file(weights: Path) -> Path:
    """Where the checksum of `weights` stands; in the format of sha256sum, which checks it with -c."""
    return weights.with_name(weights.name + ".sha256")


def write_checksum(weights: Path) -> None:
    """Write the checksum of `weights` beside them."""
    line = f"{hashlib.sha256(weights.read_bytes()).hexdigest()}  {weights.name}\n"
    checksum_file(weights).write_text(line, encoding="utf-8")


def load_shipped(weights: Path = SHIPPED) -> Generator:
    """The published generator, ready to be applied.

    Raises:
        InputError: file or checksum is missing, or they do not belong together.
    """
    try:
        published = checksum_file(weights).read_text(encoding="utf-8").split()
        found = hashlib.sha256(weights.read_bytes()).hexdigest()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "no text"
        raise InputError(f"the shipped weights cannot be read ({reason})", where=weights, remedy=_REMEDY) from None
    if published != [found, weights.name]:
        raise InputError("is not the file that was published (wrong checksum)", where=weights, remedy=_REMEDY)
    return load_generator(weights)
