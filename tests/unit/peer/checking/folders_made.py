"""A node's folder with records that their writers have signed, and a way to break it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from scenefold.base.location import WHOLE_LINE, Location
from scenefold.crypto import Record, RecordPlace
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.copies_note import encode_copies
from scenefold.peer.line.holding import Holding
from scenefold.peer.line.holding_note import encode_holding
from scenefold.store import LmdbDisk, Put, open_store
from scenefold.store.layout import TABLES, record_key
from scenefold.wire import Member, SceneLogPublic
from scenefold.world import Environment
from unit.peer.scenes_made import LOG, SPACE, first_header, sealed
from unit.store.samples import NODE, world

SCENE: SceneLogPublic = first_header()
COUNT = 60


def at(number: int) -> Location:
    return Location.from_number(number << 140)


def signed(number: int, seq: int = 1) -> Record:
    return sealed(SCENE, payload=b"payload of %d" % number * 50, location=at(number), seq=seq)


def key(number: int) -> bytes:
    return record_key(RecordPlace(SCENE.scene, SPACE, at(number)))


async def filled(folder: Path) -> None:
    """The node owns the whole line, and has a scene with records; two are owed to others."""
    async with open_store(world(), folder, NODE) as store:
        holding, member = Holding(arc=WHOLE_LINE), Member(NODE, store.identity.incarnation)
        await store.put_holding(WHOLE_LINE, encode_holding(holding), encode_copies(Copies.of(member)))
        await store.put_scene_log(SCENE.scene, SCENE.encode(), LOG)
        await store.put([Put(signed(number)) for number in range(COUNT)])
        await store.put_note("drain", b"no")


@contextmanager
def on_the_disk(folder: Path) -> Iterator[Environment]:
    environment = LmdbDisk().open(folder, TABLES)
    try:
        yield environment
    finally:
        environment.close()


def changed(folder: Path, table: str, row: bytes, value: bytes) -> None:
    """What stands there is this from now on."""
    with on_the_disk(folder) as environment:
        environment.update(lambda transaction: transaction.put(table, row, value))


def rot(folder: Path, table: str, row: bytes, byte: int = 3) -> None:
    with on_the_disk(folder) as environment, environment.read() as view:
        value = bytearray(view.get(table, row) or b"")
    value[byte % len(value)] ^= 1
    changed(folder, table, row, bytes(value))
