"""The output folder of a run: staged, and put in place only when it is complete. Standard library only.

A run writes into ``OUT/.partial`` (same file system, so that moving is a rename). `RunFolder.commit` replaces what an
earlier run left; `RunFolder.abort` removes every trace. A lock on ``OUT/.lock`` keeps two runs apart and vanishes with
the process that holds it.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import IO

from . import run_files
from .errors import InputError

_STAGING = ".partial"
_RETIRED = ".replaced"
_LOCK = ".lock"


def files_of_a_run(out: Path) -> list[Path]:
    """What an earlier run of scripts/run.py may have left in `out`, whether it is there or not."""
    return [out / name for name in run_files.NAMES] + [path for p in run_files.PATTERNS for path in out.glob(p)]


class RunFolder:
    """Owns the output folder for the time of one run.

    Args:
        out: the folder; made when it is missing.
        earlier_files: what an earlier run has left in a folder, and a new one replaces. Nothing else there is touched.
        last: the staged file that vouches for the others, and so is put in place after them.

    Raises (on construction):
        InputError: the folder cannot be made or written, or another run is using it.
    """

    def __init__(
        self,
        out: str | Path,
        earlier_files: Callable[[Path], list[Path]] = files_of_a_run,
        last: str = run_files.REPORT_FILE,
    ) -> None:
        self.out = Path(out).absolute()
        self._earlier_files, self._last = earlier_files, last
        self._created = [p for p in (self.out, *self.out.parents) if not p.exists()]
        self.staging = self.out / _STAGING
        self._lock: IO[str] | None = None
        try:
            self.out.mkdir(parents=True, exist_ok=True)
            self._lock = self._take_lock()
            for leftover in (self.staging, self.out / _RETIRED):
                shutil.rmtree(leftover, ignore_errors=True)
            self.staging.mkdir()
        except OSError as error:
            self.abort()
            raise InputError(
                f"cannot be written to ({error.strerror})", where=out, remedy="choose another folder with --out"
            ) from None
        except InputError:
            self._remove_created()
            raise

    def _take_lock(self) -> IO[str]:
        lock = open(self.out / _LOCK, "w")  # noqa: SIM115 - held open for the life of the run
        try:
            lock_exclusively(lock)
        except OSError:
            lock.close()
            raise InputError(
                "another run is writing here", where=self.out, remedy="wait for it, or choose another folder with --out"
            ) from None
        return lock

    def carry_over(self) -> None:
        """Copy what an earlier run left into the staging folder, for a run that adds to it.

        Raises:
            OSError: they could not be copied whole.
        """
        for path in self._earlier_files(self.out):
            if path.is_dir():
                shutil.copytree(path, self.staging / path.name)
            elif path.is_file():
                shutil.copy2(path, self.staging / path.name)

    def commit(self) -> None:
        """Put the staged files in place of an earlier run's; each is a rename, and the old ones go only afterwards."""
        retired = self.out / _RETIRED
        retired.mkdir(exist_ok=True)
        for path in self._earlier_files(self.out):
            if path.exists():
                os.replace(path, retired / path.name)
        for path in sorted(self.staging.iterdir(), key=lambda p: p.name == self._last):
            os.replace(path, self.out / path.name)
        self.staging.rmdir()
        shutil.rmtree(retired, ignore_errors=True)
        self._release()

    def abort(self, keep: str = "") -> Path | None:
        """Remove what was staged and any folder that was made for it.

        Args:
            keep: a staged file to keep as ``OUT/failed.<name>`` (the log of a run that met a defect).

        Returns:
            Where the kept file is, or None.
        """
        kept = None
        source = self.staging / keep
        if keep and source.is_file():
            kept = self.out / f"failed.{keep}"
            os.replace(source, kept)
        shutil.rmtree(self.staging, ignore_errors=True)
        self._release()
        self._remove_created()
        return kept

    def _release(self) -> None:
        if self._lock is not None:
            self._lock.close()
            self._lock = None
            (self.out / _LOCK).unlink(missing_ok=True)

    def _remove_created(self) -> None:
        for path in self._created:
            with contextlib.suppress(OSError):  # not empty, or never made
                path.rmdir()


def lock_exclusively(file: IO[str]) -> None:
    """Lock `file` for this process or raise OSError at once; the system releases it when the process ends."""
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
