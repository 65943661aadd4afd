"""Command lines of scripts: inside Blender too, and complaints in one line. Standard library only."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import NoReturn

from .errors import InputError
from .job_console import EXIT_CANCELLED, EXIT_DONE, EXIT_INPUT


def script_arguments() -> list[str]:
    """The arguments of the script that runs; under ``blender -b -P SCRIPT -- ARGUMENTS`` Blender's own come before."""
    inside_blender = "bpy" in sys.modules and "--" in sys.argv
    return sys.argv[sys.argv.index("--") + 1 :] if inside_blender else sys.argv[1:]


def exit_code(program: str, work: Callable[[], None], *, stopped: str = "stopped") -> int:
    """Do a script's `work`; returns the exit code, with a line on stderr where that is not 0.

    Args:
        program: the script's name.
        work: may raise `InputError`.
        stopped: what is said after Ctrl-C.
    """
    try:
        work()
    except InputError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return EXIT_INPUT
    except KeyboardInterrupt:
        print(f"{program}: {stopped}", file=sys.stderr)
        return EXIT_CANCELLED
    return EXIT_DONE


class OneLineParser(argparse.ArgumentParser):
    """Raises `InputError` where argparse would print its usage and leave."""

    def error(self, message: str) -> NoReturn:
        raise InputError(message, remedy="see --help")
