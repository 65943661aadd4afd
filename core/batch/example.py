"""A small batch file to begin with, on the capture that comes with the product. Standard library only."""

from __future__ import annotations

import os
from pathlib import Path

from ..demo import SHOWROOM
from ..errors import InputError
from ..files.untrusted import writing_whole

_TEXT = """\
# A batch of turntables. Try it:
#
#     python scripts/turntable.py {name} --out turntables --dry-run
#     python scripts/turntable.py {name} --out turntables
#
# Paths are relative to this file. Everything below stands for its own default where it is left out, except [[items]].

title = "Showroom"
layers = ["original", "deutan-1.0"]     # protan, deutan, tritan, achromat with a severity from 0 to 1
outputs = ["frames", "simulated", "video", "side-by-side", "contact-sheet", "page"]
retries = 1                             # how often a failed task is tried again

[train]                                 # options of scripts/run.py for items that are captures
iterations = 1500                       # 5000 for the real thing
enhancer = "scene"

[turntable]
frames = 24                             # of a turn
frames_per_second = 12
size = [320, 240]
engines = ["cycles"]                    # and "eevee"
chunk = 12                              # frames that are rendered at one go

[cameras.level]                         # a turn for each camera
radius = 0.0                            # in scene units; 0: as far away as the photographs were taken
# height = 0.25                         # above the middle, as a share of the radius; else as high as the photographs
focal_length = 0.0                      # millimetres; 0: that of the photographs
arc = 0.0                               # degrees; 360: a full turn; 0: as far around as the photographs were taken

[needs]                                 # what a task may take of a machine
train_cores = 4
train_memory_mb = 4096
frame_cores = 1
frame_memory_mb = 2048

[[items]]
name = "showroom"
capture = {capture}

# A finished run is taken as it is; an item's own values come before those above.
#
# [[items]]
# run = "out/demo"
# layers = ["original", "deutan-1.0", "protan-0.6"]
# turntable.frames = 48
# cameras = ["level"]
"""


def write_example(path: Path) -> Path:
    """Write the batch file; returns `path`.

    Raises:
        InputError: it exists, or cannot be written.
    """
    if os.path.lexists(path):
        raise InputError("already exists", where=path, remedy="choose another name")
    with writing_whole(path) as file:
        file.write(_TEXT.format(name=path.name, capture=_quoted(str(SHOWROOM))).encode())
    return path


def _quoted(text: str) -> str:
    """A TOML string, literal where that is possible: paths of Windows have backslashes."""
    return f"'{text}'" if "'" not in text else '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
