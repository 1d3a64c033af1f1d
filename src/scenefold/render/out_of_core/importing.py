"""The import in a process of its own, whose memory goes with it: `python -m scenefold.render.out_of_core.importing`.

Its records go to a file of the process that asked, by descriptor; it answers with one JSON document, or the three parts of an error.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import trio

from scenefold.base.errors import LocalFault
from scenefold.render.out_of_core.records import RecordsOnDisk, write_records
from scenefold.render.out_of_core.spill import Spill, SpillFile
from scenefold.scene.importers import Moment, plan_import, read_scene


@dataclass(frozen=True, slots=True)
class Imported:
    """A file's records, and what it could not be made of."""

    records: RecordsOnDisk
    not_carried: tuple[str, ...]
    bytes: int


async def import_apart(file: Path, spill: Spill, moment: Moment | None = None, environment: Path | None = None) -> Imported:
    """Import a scene file in another process; LocalFault says what is wrong with the file."""
    records = spill.file()
    asked = {
        "file": str(file),
        "folder": str(spill.folder),
        "descriptor": records.number,
        "time_s": None if moment is None else moment.time_s,
        "animation": None if moment is None else moment.animation,
        "environment": None if environment is None else str(environment),
    }
    command = [sys.executable, "-m", __spec__.name, json.dumps(asked)]
    done = await trio.run_process(command, capture_stdout=True, check=False, pass_fds=(records.number,))
    try:
        answer = json.loads(done.stdout)
    except ValueError as error:
        what = f"the process that imports ended with code {done.returncode}"
        raise LocalFault(what, where=str(file), remedy="if it was killed for lack of memory, import on a larger machine") from error
    if "what" in answer:
        raise LocalFault(answer["what"], where=answer["where"], remedy=answer["remedy"])
    size = int(answer["bytes"])
    index = await trio.to_thread.run_sync(partial(RecordsOnDisk, records, size))
    return Imported(index, tuple(answer["not_carried"]), size)


class _Given(SpillFile):
    """The file of the process that asked."""

    def __init__(self, folder: Path, descriptor: int) -> None:
        self._folder = folder
        self._file = os.fdopen(descriptor, "r+b", buffering=0)
        self.size = 0


def _import(asked: dict[str, object]) -> dict[str, object]:
    time_s, animation, environment = asked["time_s"], asked["animation"], asked["environment"]
    assert isinstance(time_s, float | int | None) and isinstance(animation, str | None) and isinstance(environment, str | None)
    given = _Given(Path(str(asked["folder"])), int(str(asked["descriptor"])))
    plan = plan_import(read_scene(str(asked["file"]), Moment(time_s, animation), environment))
    write_records(plan, given)
    return {"bytes": given.size, "not_carried": list(plan.not_carried)}


def main() -> None:
    """Import what the only argument asks for."""
    try:
        answer = _import(json.loads(sys.argv[1]))
    except LocalFault as fault:
        answer = {"what": fault.what, "where": fault.where, "remedy": fault.remedy}
    sys.stdout.write(json.dumps(answer))


if __name__ == "__main__":
    main()
