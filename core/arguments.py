"""Command lines that complain in one line, as the contract wants. Standard library only."""

from __future__ import annotations

import argparse
from typing import NoReturn

from .errors import InputError


class OneLineParser(argparse.ArgumentParser):
    """Raises `InputError` where argparse would print its usage and leave."""

    def error(self, message: str) -> NoReturn:
        raise InputError(message, remedy="see --help")
