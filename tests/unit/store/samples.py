"""Records for tests of the store. It never verifies, so they are signed by nobody and encrypt nothing."""

from __future__ import annotations

import hashlib

from scenefold.base.ids import KeyId, NodeId, SceneId, SpaceId, node_id_of
from scenefold.base.location import Location
from scenefold.crypto import Record, RecordHeader, RecordPlace
from scenefold.store import LmdbDisk, Put
from scenefold.world import World, offline_world

NODE: NodeId = node_id_of("127.0.0.2")
SCENE = SceneId(7)
SPACE = SpaceId(2)


def place(number: int, *, space: int = SPACE, scene: int = SCENE) -> RecordPlace:
    return RecordPlace(SceneId(scene), SpaceId(space), Location.from_number(number))


def record(number: int, *, seq: int = 1, text: bytes = b"", size: int = 64, space: int = SPACE, scene: int = SCENE) -> Record:
    """A record at a place, of `size` bytes that begin with `text`."""
    ciphertext = text.ljust(max(size, 16), b".")
    header = RecordHeader(
        scene=SceneId(scene),
        genesis=bytes(32),
        space=SpaceId(space),
        location=Location.from_number(number),
        epoch=0,
        seq=seq,
        writer=KeyId(1),
        session=1,
        content_position=0,
        key_epoch=0,
        nonce=bytes(12),
        length=len(ciphertext),
        digest=hashlib.sha256(ciphertext).digest(),
    )
    return Record(header.encode(), bytes(64), ciphertext)


def put(number: int, *, expect: bytes | None = None, **details: int) -> Put:
    return Put(record(number, **details), expect)


def world(*, map_bytes: int = 1 << 20) -> World:
    return offline_world(disk=LmdbDisk(map_bytes_first=map_bytes))
