"""A node whose disk can be made slow: `python -m scenectl.slow_node ARGUMENTS`, the arguments those of a node.

For measurements alone. While there is a file beside its data folder that bears its name and `.slow`, each look at the disk and each commit
takes as many seconds longer as the file says, in the thread that looks, as a disk does that tries again and again.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from scenefold.node.__main__ import main as run
from scenefold.store.lmdb_disk import LmdbEnvironment
from scenefold.world.ports import ReadTransaction, WriteTransaction

T = TypeVar("T")


def slow_file_of(data: Path) -> Path:
    """The file that makes the disk of a data folder slow."""
    return data.with_name(f"{data.name}.slow")


def slow_down(file: Path) -> None:
    """Have this process's disk be as slow as the file says."""
    read, update = LmdbEnvironment.read, LmdbEnvironment.update

    def wait() -> None:
        try:
            seconds = float(file.read_text())
        except (FileNotFoundError, ValueError):
            return
        time.sleep(seconds)

    @contextmanager
    def slow_read(self: LmdbEnvironment) -> Iterator[ReadTransaction]:
        wait()
        with read(self) as transaction:
            yield transaction

    def slow_update(self: LmdbEnvironment, change: Callable[[WriteTransaction], T]) -> T:
        wait()
        return update(self, change)

    patched: Any = LmdbEnvironment
    patched.read, patched.update = slow_read, slow_update


def main() -> int:
    parser = argparse.ArgumentParser(allow_abbrev=False)
    parser.add_argument("--data", type=Path, required=True)
    options, arguments = parser.parse_known_args()
    slow_down(slow_file_of(options.data))
    return run([*arguments, "--data", str(options.data)])


if __name__ == "__main__":
    sys.exit(main())
