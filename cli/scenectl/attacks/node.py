"""A node that takes part in an attack: `python -m scenectl.attacks.node [--frame-s N] ARGUMENTS`, the arguments those of a node.

`--frame-s`: it waits no longer for the rest of a frame, so that what takes a minute else happens within an attack. While there is a file
beside its data folder that bears its name and `.lie`, it lies to whoever reads, as the file says: `garbage`, or `old`, the first version
of each record that it met since the file came.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from random import Random

from scenefold.base.ids import SceneId
from scenefold.peer.records.reads import Found, Reads
from scenefold.wire import RecordBytes, RecordKey
from scenefold.world import serving

GARBAGE, OLD = "garbage", "old"


class Liar:
    """What is told instead of the truth."""

    def __init__(self, lie: Path) -> None:
        self._lie = lie
        self._dice = Random(1)
        self._first: dict[tuple[SceneId, RecordKey], RecordBytes | None] = {}

    def told(self, scene: SceneId, keys: Sequence[RecordKey], truth: Found) -> Found:
        match self._lie.read_text() if self._lie.exists() else "":
            case "garbage":
                return truth._replace(records=[self._noise(record) for record in truth.records])
            case "old":
                firsts = [self._first.setdefault((scene, key), record) for key, record in zip(keys, truth.records, strict=False)]
                return truth._replace(records=firsts)
            case _:
                self._first.clear()
                return truth

    def _noise(self, record: RecordBytes | None) -> RecordBytes | None:
        if record is None:
            return None
        fields = [record.signature, record.header, record.ciphertext]
        which = self._dice.randrange(4)
        if which == 3:
            fields = [self._dice.randbytes(len(one)) for one in fields]
        else:
            at = self._dice.randrange(len(fields[which]))
            fields[which] = fields[which][:at] + bytes((fields[which][at] ^ 1 << self._dice.randrange(8),)) + fields[which][at + 1 :]
        return RecordBytes(*fields)


def lie_of(data: Path) -> Path:
    """The file that tells the node of a data folder to lie."""
    return data.with_name(f"{data.name}.lie")


def lie_as(lie: Path) -> None:
    """Have this process's node answer reads as the file says."""
    liar, honest = Liar(lie), Reads.get

    async def get(self: Reads, scene: SceneId, keys: Sequence[RecordKey], position: int, *, forward: bool) -> Found:
        return liar.told(scene, keys, await honest(self, scene, keys, position, forward=forward))

    Reads.get = get  # type: ignore[method-assign]


def main() -> int:
    parser = argparse.ArgumentParser(allow_abbrev=False)
    parser.add_argument("--frame-s", type=float)
    parser.add_argument("--data", type=Path, required=True)
    options, arguments = parser.parse_known_args()
    if options.frame_s is not None:
        serving.FRAME_S_MAX = options.frame_s  # type: ignore[attr-defined]
    lie_as(lie_of(options.data))
    from scenefold.node.program import main as run

    return run([*arguments, "--data", str(options.data)])


if __name__ == "__main__":
    sys.exit(main())
