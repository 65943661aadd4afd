"""The licences of installed packages, and whether they may be combined with ours. Standard library only.

What a package says of itself is taken as it is: the SPDX expression in its metadata, else its classifier, else its
licence field where that is a name and not a text.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from email.message import Message
from importlib import metadata
from pathlib import Path
from typing import cast

from .errors import InputError

# Free, and compatible with GPL-3.0-or-later by the list of licences of the Free Software Foundation.
COMPATIBLE = (
    r"0BSD|([23]-Clause )?BSD|BSD[- ][23][- ]Clause( License)?|BSD License|MIT( License)?|MIT-CMU|HPND|ISC|Zlib|"
    r"Unlicense|CC0-1\.0|Apache[- ]2\.0( WITH LLVM-exception)?|Apache Software License|BSL-1\.0|PSF-2\.0|"
    r"Python Software Foundation License|MPL-2\.0|Mozilla Public License 2\.0 \(MPL 2\.0\)|"
    r"L?GPL-(2\.[01]|3\.0)-or-later|L?GPL-3\.0(-only)?|GNU General Public License v3 or later \(GPLv3\+\)"
)
_NAME = re.compile(r"[\w .+()-]{2,40}")
_ENTRY = re.compile(r"^([\w.-]+)==", re.MULTILINE)


@dataclass(frozen=True)
class Licence:
    """A package, the version that is installed, and its licence."""

    package: str
    version: str
    licence: str

    @property
    def is_compatible(self) -> bool:
        """Whether one of the alternatives that the licence offers consists of `COMPATIBLE` licences."""
        if re.fullmatch(COMPATIBLE, self.licence):
            return True
        return any(
            all(re.fullmatch(COMPATIBLE, part.strip("( )")) for part in alternative.split(" AND "))
            for alternative in self.licence.split(" OR ")
        )


def listed_packages(requirements: Path) -> list[str]:
    """The packages of a requirements file, without those that it includes."""
    return list(dict.fromkeys(_ENTRY.findall(requirements.read_text(encoding="utf-8"))))  # one may be there per Python


def licences_of(packages: Iterable[str]) -> list[Licence]:
    """Of those that are installed here; others are for other systems.

    Raises:
        InputError: a package does not say what its licence is.
    """
    found = []
    for package in packages:
        try:
            distribution = metadata.distribution(package)
        except metadata.PackageNotFoundError:
            continue
        found.append(Licence(distribution.metadata["Name"], distribution.version, _licence(distribution)))
    return found


def _licence(distribution: metadata.Distribution) -> str:
    fields = cast(Message, distribution.metadata)  # which it is; its protocol lacks `get`
    classifiers = [text.rpartition(" :: ")[2] for text in fields.get_all("Classifier", []) if "License ::" in text]
    named = [text for text in classifiers if text not in ("OSI Approved", "DFSG approved")]
    given = (fields.get("License") or "").strip()
    is_name = _NAME.fullmatch(given) and given != "UNKNOWN"
    licence = fields.get("License-Expression") or " AND ".join(named) or (given if is_name else "")
    if not licence:
        remedy = "read its licence and decide; licences.py cannot"
        raise InputError("does not say what its licence is", where=fields["Name"], remedy=remedy)
    return licence
