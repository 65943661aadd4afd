"""The C++ headers beside this file, as text for Warp's compilers."""

from __future__ import annotations

from importlib import resources


def read_headers(names: tuple[str, ...]) -> str:
    """The headers one after the other: Warp takes a preamble, not files that include each other."""
    folder = resources.files(__package__)
    texts = (folder.joinpath(name).read_text(encoding="utf-8") for name in names)
    return "\n".join(text.replace("#pragma once", "") for text in texts)
