"""The disk of a simulated machine (port `Disk`): it outlives the processes that write on it, and it can be broken.

An update becomes durable in one instant, at the end of `update`. What it costs in time is charged by the workers, a part
before that instant and a part after it (workers.py): a crash in the first part loses the update, a crash in the second
one loses only its acknowledgement. A torn last write is a crash in the first part: of a commit whose meta page is torn
the other meta page is left, which is the state before.

A disk without a free byte takes no update at all, as under LMDB: what changes is copied to pages that must be found first, also
where something is only deleted.

A disk that lies about its syncs (`lies`) loses its last commit in a torn crash, although it was acknowledged.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import TypeVar

from scenefold.base.errors import LocalFault
from scenefold.world.ports import DiskFailed, DiskFull, DiskSpace, ReadTransaction, WriteTransaction
from scenefold.world.sim.tables import ReadView, Table, WriteView

T = TypeVar("T")

TOTAL_BYTES = 1 << 40
CRASHED = "the machine of this process has crashed"

Undo = list[tuple[str, bytes, bytes | None]]
Passing = Callable[[str], bool]
"""Called with "before commit" and "after commit"; False if the process is dead (it may have died in this call)."""


@dataclass(slots=True, eq=False)
class Folder:
    """A data folder: its tables, who has it open, and how to take back the last commit."""

    tables: dict[str, Table] = field(default_factory=dict)
    holder: SimEnvironment | None = None
    last_commit: Undo = field(default_factory=list)
    rotten: dict[tuple[str, bytes], tuple[bytes, bytes]] = field(default_factory=dict)
    """Values that rotted, by table and key: what each has become, and what it was."""
    file_bytes: int = 0
    """As in LMDB, a file never shrinks: what is deleted leaves room inside it."""

    @property
    def live_bytes(self) -> int:
        return sum(table.bytes for table in self.tables.values())

    def writable(self, name: str) -> Table:
        """The table, or a copy in its place if somebody reads it."""
        table = self.tables[name]
        if table.readers:
            table = self.tables[name] = table.copy()
        return table

    def roll_back(self) -> None:
        for name, key, value in reversed(self.last_commit):
            self.writable(name).set(key, value)
        self.last_commit = []

    def copy(self) -> Folder:
        tables = {name: table.copy() for name, table in self.tables.items()}
        return Folder(tables, rotten=dict(self.rotten), file_bytes=self.file_bytes)

    def rot(self, name: str, key: bytes, damaged: bytes) -> None:
        """A value has become another one."""
        self.rotten[name, key] = damaged, self.sound(name, key)
        self.writable(name).set(key, damaged)

    def sound(self, name: str, key: bytes) -> bytes:
        """A value as it was written."""
        value = self.tables[name].values[key]
        damaged, before = self.rotten.get((name, key), (b"", b""))
        return before if damaged == value else value


class SimDisk:
    """The disk of one machine. `open` is for a process that never dies; SimNet gives each process its own door."""

    def __init__(self, *, total_bytes: int = TOTAL_BYTES) -> None:
        self._folders: dict[str, Folder] = {}
        self._total_bytes = total_bytes
        self._free_bytes: int | None = None
        self.sync_s = 0.0
        """Seconds that every update takes longer."""
        self.lies = False
        """A torn crash takes back the last commit of each folder, acknowledged or not."""
        self.fails = False
        """Whoever writes hears DiskFailed, and can write no more until the folder is opened anew."""
        self.commits = 0

    def open(self, folder: Path, tables: Sequence[str], /) -> SimEnvironment:
        return self.open_for(folder, tables, _lives_forever)

    def open_for(self, folder: Path, tables: Sequence[str], passing: Passing) -> SimEnvironment:
        """Open a folder for a process that is asked at each commit whether it lives."""
        held = self._folders.setdefault(str(folder), Folder())
        if held.holder is not None:
            raise LocalFault("the data folder is in use by another process", where=str(folder), remedy="stop that process")
        for name in tables:
            held.tables.setdefault(name, Table())
        held.holder = SimEnvironment(self, held, tables, passing)
        return held.holder

    # ------------------------------------------------------------------------------------------------ faults

    def crash(self, *, torn: bool = False) -> None:
        """The processes are gone: folders are released, and their environments are dead."""
        for folder in self._folders.values():
            if folder.holder is not None:
                folder.holder.die()
                folder.holder = None
            if torn and self.lies:
                folder.roll_back()
            folder.last_commit = []

    def fill(self, free_bytes: int | None = 0) -> None:
        """Others fill the disk up to so many free bytes; None: they clean up."""
        self._free_bytes = free_bytes

    def slow(self, seconds: float) -> None:
        """Every update takes so many seconds longer."""
        self.sync_s = seconds

    def corrupt(self, table: str, dice: Random, key: bytes | None = None) -> bytes | None:
        """Turn a bit of a value over; that of any key if none is given. Returns its key, None if there is nothing."""
        for folder in self._folders.values():
            keys = folder.tables[table].keys if table in folder.tables else []
            victim = dice.choice(keys) if key is None and keys else key
            value = folder.tables[table].values.get(victim) if victim is not None and keys else None
            if victim is not None and value:
                bit = dice.randrange(8 * len(value))
                damaged = bytearray(value)
                damaged[bit // 8] ^= 1 << bit % 8
                folder.rot(table, victim, bytes(damaged))
                return victim
        return None

    def wipe(self) -> None:
        """A new disk is put in."""
        self.crash()
        self._folders.clear()

    def snapshot(self) -> dict[str, Folder]:
        """A backup of everything, for `restore`."""
        return {name: folder.copy() for name, folder in self._folders.items()}

    def restore(self, backup: dict[str, Folder]) -> None:
        """Bring the disk back to an earlier state: a rolled-back backup. The processes on it die."""
        self.crash()
        self._folders = {name: folder.copy() for name, folder in backup.items()}

    def peek(self, table: str) -> Mapping[bytes, bytes]:
        """What a table holds now, over all folders, for who checks the truth: not a copy, so look and let go."""
        found = [folder.tables[table].values for folder in self._folders.values() if table in folder.tables]
        return found[0] if len(found) == 1 else ChainMap(*found)

    @contextmanager
    def looked_at(self, tables: Sequence[str]) -> Iterator[ReadTransaction]:
        """What lies in all tables now, for who checks a store as a whole; whoever has it open goes on."""
        (folder,) = self._folders.values() or (Folder(),)
        view = ReadView({name: folder.tables.get(name, Table()) for name in tables})
        try:
            yield view
        finally:
            view.end()

    def written(self, table: str) -> Mapping[bytes, bytes]:
        """Likewise as it was written, whatever has rotted since."""
        sound = self.rotten(table)
        return ChainMap(sound, dict(self.peek(table))) if sound else self.peek(table)

    def replaced(self, table: str) -> list[tuple[bytes, bytes | None]]:
        """What the last commit changed in a table: the keys, each with what was there before (None: nothing)."""
        return [(key, before) for folder in self._folders.values() for name, key, before in folder.last_commit if name == table]

    def rotten(self, table: str) -> dict[bytes, bytes]:
        """The values that have rotted and are still there, as they were written."""
        return {
            key: before
            for folder in self._folders.values()
            for (name, key), (damaged, before) in folder.rotten.items()
            if name == table and folder.tables[name].values.get(key) == damaged != before
        }

    def space(self, folder: Folder) -> DiskSpace:
        live, free = folder.live_bytes, self.free_bytes
        return DiskSpace(used=live, reusable=max(0, folder.file_bytes - live), free=free, total=self._total_bytes)

    @property
    def free_bytes(self) -> int:
        if self._free_bytes is not None:
            return self._free_bytes
        return max(0, self._total_bytes - sum(folder.file_bytes for folder in self._folders.values()))

    def require_a_page(self) -> None:
        """DiskFull if nothing whatever can be written."""
        if self.free_bytes == 0:
            raise DiskFull("no room on the simulated disk, not for one page")

    def lengthen(self, folder: Folder, file_bytes: int) -> None:
        """Make a file as long as its contents need; DiskFull if there is no room."""
        growth = file_bytes - folder.file_bytes
        if growth <= 0:
            return
        if growth > self.free_bytes:
            raise DiskFull("no room on the simulated disk")
        if self._free_bytes is not None:
            self._free_bytes -= growth
        folder.file_bytes = file_bytes


class SimEnvironment:
    """An open folder (port `Environment`)."""

    def __init__(self, disk: SimDisk, folder: Folder, tables: Sequence[str], passing: Passing) -> None:
        self._disk = disk
        self._folder = folder
        self._names = tuple(tables)
        self._passing = passing
        self._dead: str | None = None
        self._failed: str | None = None
        self._is_updating = False

    @contextmanager
    def read(self) -> Iterator[ReadTransaction]:
        self._check()
        tables = {name: self._folder.tables[name] for name in self._names}
        for table in tables.values():
            table.readers += 1
        view = ReadView(tables)
        try:
            yield view
        finally:
            for table in tables.values():
                table.readers -= 1
            view.end()

    def update(self, change: Callable[[WriteTransaction], T]) -> T:
        self._check()
        if self._failed is not None:
            raise DiskFailed(self._failed)
        assert not self._is_updating, "one writer at a time"
        self._is_updating = True
        view = WriteView({name: self._folder.tables[name] for name in self._names})
        try:
            result = change(view)
        finally:
            self._is_updating = False
            view.end()
        if not self._passing("before commit"):
            raise DiskFailed(CRASHED)
        if self._disk.fails:
            self._failed = "the simulated disk failed"
            raise DiskFailed(self._failed)
        self._commit(view.changes)
        if not self._passing("after commit"):
            raise DiskFailed(CRASHED)
        return result

    def _commit(self, changes: dict[str, dict[bytes, bytes | None]]) -> None:
        folder, undo = self._folder, []
        if any(changes.values()):
            self._disk.require_a_page()
        for name, entries in changes.items():
            if entries:
                table = folder.writable(name)
                undo += [(name, key, table.values.get(key)) for key in entries]
                for key, value in entries.items():
                    table.set(key, value)
        folder.last_commit, before = undo, folder.last_commit
        try:
            self._disk.lengthen(folder, folder.live_bytes)
        except DiskFull:
            folder.roll_back()
            folder.last_commit = before
            raise
        self._disk.commits += 1

    def space(self) -> DiskSpace:
        self._check()
        return self._disk.space(self._folder)

    def close(self) -> None:
        if self._dead is None:
            self._folder.holder = None
            self._dead = "the store is closed"

    def die(self) -> None:
        """The process is gone; whatever its tasks still try here fails and leaves nothing."""
        self._dead = CRASHED

    def _check(self) -> None:
        if self._dead is not None:
            raise DiskFailed(self._dead)


def _lives_forever(_what: str) -> bool:
    return True
