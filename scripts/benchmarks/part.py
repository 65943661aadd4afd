"""What scripts/benchmark.py needs to know of a part."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Part:
    """A subcommand that measures something.

    Attributes:
        name: of the subcommand, and of the files that it writes.
        summary: one line of help.
        add_arguments: declares what it takes; ``--out`` is there.
        measure: does it and writes its files into ``options.out``; returns the text to show.
    """

    name: str
    summary: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    measure: Callable[[argparse.Namespace], str]
