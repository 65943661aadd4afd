"""Command lines of scripts: inside Blender too, and complaints in one line. Standard library only."""

from __future__ import annotations

import argparse
import shutil
import signal
import sys
import time
import typing
from collections.abc import Callable, Iterable
from functools import partial
from typing import NoReturn, TextIO

from ..errors import InputError, one_line
from ..settings import AUTO, OPTIONS, Settings, flag
from .devices import explain_fault
from .progress import format_seconds
from .protocol import LEAST_SHARE, Reporter
from .supervisor import EXIT_CANCELLED, EXIT_DONE, EXIT_INPUT, handling_signals, write_while_possible


def script_arguments() -> list[str]:
    """The arguments of the script that runs; under ``blender -b -P SCRIPT -- ARGUMENTS`` Blender's own come before."""
    inside_blender = "bpy" in sys.modules and "--" in sys.argv
    return sys.argv[sys.argv.index("--") + 1 :] if inside_blender else sys.argv[1:]


def exit_code(program: str, work: Callable[[], None], *, stopped: str = "stopped") -> int:
    """Do a script's `work`; returns the exit code, with a line on stderr where that is not 0.

    Whoever terminates the process (SIGTERM) stops it like Ctrl-C, so that nothing half-made is left.

    Args:
        program: the script's name.
        work: may raise `InputError`, and what faults of the machine raise; a defect of ours goes on as it is.
        stopped: what is said after it was stopped.
    """
    try:
        with handling_signals(signal.default_int_handler, signal.SIGTERM):
            work()
    except InputError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return EXIT_INPUT
    except KeyboardInterrupt:
        print(f"{program}: {stopped}", file=sys.stderr)
        return EXIT_CANCELLED
    except Exception as error:
        explanation = explain_fault(error, smaller="close other programs, or give it less to do")
        if not explanation:
            raise
        print(f"{program}: {one_line(explanation)}", file=sys.stderr)
        return EXIT_INPUT
    return EXIT_DONE


class OneLineParser(argparse.ArgumentParser):
    """Raises `InputError` where argparse would print its usage and leave."""

    def error(self, message: str) -> NoReturn:
        raise InputError(message, remedy="see --help")


def add_settings(parser: argparse.ArgumentParser, names: Iterable[str]) -> None:
    """Declare the command line's options for the fields `names` of `Settings`, whose ranges it checks itself.

    What is parsed has only those that are given; the others' defaults are those of `Settings`.
    """
    add = partial(parser.add_argument, default=argparse.SUPPRESS)
    hints = typing.get_type_hints(Settings)
    for name in names:
        option, default = OPTIONS[name], getattr(Settings, name)
        text = f"{option.text}: {'|'.join(option.choices)}" if option.choices else option.text
        shown = text if default == "" else f"{text} ({AUTO if default is None else default})"
        if hints[name] is bool and not default:
            add(flag(name), action="store_true", help=option.text)
        elif bool in (hints[name], *typing.get_args(hints[name])):
            add(flag(name), action=argparse.BooleanOptionalAction, help=text if default else shown)
        else:
            kinds = typing.get_args(hints[name])
            kind = hints[name] if not kinds else _whole_or_auto if int in kinds else _number_or_auto
            metavar = option.metavar or name.upper()
            add(flag(name), type=kind, metavar=metavar, help=shown)


def _whole_or_auto(text: str) -> int | None:
    return None if text == AUTO else int(text)


def _number_or_auto(text: str) -> float | None:
    return None if text == AUTO else float(text)


# argparse names the function when the text is neither.
_whole_or_auto.__name__ = _number_or_auto.__name__ = f"number or {AUTO}"
_QUIET_INTERVAL = 30.0  # seconds between lines when the stream is not a terminal
_LIVELY_INTERVAL = 0.2


class ConsoleReporter(Reporter):
    """Rewrites one line on a terminal; elsewhere says something now and then, while the stream can be written to."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._terminal = stream.isatty()
        self._stage, self._started, self._first, self._last, self._fraction = "", 0.0, 0.0, 0.0, 0.0

    def status(self, stage: str, message: str) -> None:
        write_while_possible(self._stream, f"{stage}: {message}\n")

    def progress(self, stage: str, fraction: float, message: str = "") -> None:
        now = time.monotonic()
        if stage != self._stage or fraction < self._fraction:  # another one, or the same once more
            # A resumed stage does not start at 0, so its pace counts from where it was first heard of.
            self._stage, self._started, self._first, self._last = stage, now, fraction, now
        self._fraction = fraction
        interval = _LIVELY_INTERVAL if self._terminal else _QUIET_INTERVAL
        if now - self._last < interval and fraction < 1.0:
            return
        self._last = now
        done = fraction - self._first
        left = f", {format_seconds((now - self._started) / done * (1.0 - fraction))} left" if done > LEAST_SHARE else ""
        text = f"{stage} {fraction:4.0%}{left}  {message}"
        if self._terminal:
            width = shutil.get_terminal_size().columns - 1
            write_while_possible(self._stream, "\r" + text[:width].ljust(width) + ("\n" if fraction >= 1.0 else ""))
        else:
            write_while_possible(self._stream, text.rstrip() + "\n")

    def warning(self, name: str, message: str) -> None:
        write_while_possible(self._stream, f"note: {message}\n")
