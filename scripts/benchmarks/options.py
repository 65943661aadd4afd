"""Kinds of values that several parts take on the command line."""

from __future__ import annotations

import argparse
from pathlib import Path


def names(text: str) -> tuple[str, ...]:
    """Words between commas."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def numbers(text: str) -> tuple[float, ...]:
    """Numbers between commas."""
    return tuple(float(number) for number in names(text))


def named_path(text: str) -> tuple[str, Path]:
    """A name and a path with an equals sign between them."""
    name, separator, path = text.partition("=")
    if not separator or not name or not path:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=PATH")
    return name, Path(path)
