"""Records for tests of the store. It never verifies, so they are signed by nobody and encrypt nothing."""

from __future__ import annotations

import hashlib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from scenefold.base.ids import KeyId, NodeId, SceneId, SpaceId, node_id_of
from scenefold.base.location import WHOLE_LINE, Arc, Location
from scenefold.crypto import EXPECTS_ANYTHING, PLACED_BY_NODE, Record, RecordHeader, RecordPlace
from scenefold.store import LmdbDisk, Put, Store, open_store
from scenefold.world import World, offline_world

NODE: NodeId = node_id_of("127.0.0.2")
SCENE = SceneId(7)
SPACE = SpaceId(2)
NOWHERE = b"\1" * 32
"""The digest of no record."""


def place(number: int, *, space: int = SPACE, scene: int = SCENE) -> RecordPlace:
    return RecordPlace(SceneId(scene), SpaceId(space), Location.from_number(number))


def record(
    number: int,
    *,
    seq: int = 1,
    text: bytes = b"",
    size: int = 64,
    space: int = SPACE,
    scene: int = SCENE,
    expects: bytes = EXPECTS_ANYTHING,
    epoch: int = 0,
) -> Record:
    """A record at a place, of `size` bytes that begin with `text`."""
    ciphertext = text.ljust(max(size, 16), b".")
    header = RecordHeader(
        scene=SceneId(scene),
        genesis=bytes(32),
        space=SpaceId(space),
        location=Location.from_number(number),
        epoch=epoch,
        seq=seq,
        writer=KeyId(1),
        session=1,
        expects=expects,
        content_position=0,
        key_epoch=0,
        nonce=bytes(12),
        length=len(ciphertext),
        digest=hashlib.sha256(ciphertext).digest(),
    )
    return Record(header.encode(), bytes(64), ciphertext)


def managed(object_number: int, **details: Any) -> Record:
    """A record whose place the node chooses; `details` as of any."""
    fixed = record(object_number, **details)
    header = fixed.header._replace(location=Location(bytes(4) + object_id(object_number)), placement=PLACED_BY_NODE)
    return Record(header.encode(), fixed.signature, fixed.ciphertext)


def object_id(number: int) -> bytes:
    return hashlib.sha256(b"%d" % number).digest()[:16]


def put(number: int, **details: Any) -> Put:
    return Put(record(number, **details))


def world(*, map_bytes: int = 1 << 20) -> World:
    return offline_world(disk=LmdbDisk(map_bytes_first=map_bytes))


def arc(first: int, last: int) -> Arc:
    return Arc(Location.from_number(first), Location.from_number(last))


@asynccontextmanager
async def whole_store(where: World, folder: Path, **options: int) -> AsyncIterator[Store]:
    """The store of a node that owns the whole line."""
    async with open_store(where, folder, NODE, **options) as store:
        await store.put_holding(WHOLE_LINE, b"")
        yield store
