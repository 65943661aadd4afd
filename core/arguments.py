"""Command lines of scripts: inside Blender too, and complaints in one line. Standard library only."""

from __future__ import annotations

import argparse
import sys
from typing import NoReturn

from .errors import InputError


def script_arguments() -> list[str]:
    """The arguments of the script that runs; under ``blender -b -P SCRIPT -- ARGUMENTS`` Blender's own come before."""
    inside_blender = "bpy" in sys.modules and "--" in sys.argv
    return sys.argv[sys.argv.index("--") + 1 :] if inside_blender else sys.argv[1:]


class OneLineParser(argparse.ArgumentParser):
    """Raises `InputError` where argparse would print its usage and leave."""

    def error(self, message: str) -> NoReturn:
        raise InputError(message, remedy="see --help")
