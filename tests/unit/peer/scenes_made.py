"""Scenes and records made from scratch, so that tests can bend one thing about them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from scenefold.base.ids import KeyId, NodeId, SceneId, SpaceId
from scenefold.base.location import FIRST, Location
from scenefold.crypto import HEADER_DOMAIN, Record, SigningKey, key_id_of, seal_record
from scenefold.wire import KeyEntry, PutItem, SceneLogPublic, SceneMode, SpaceEntry, WriterEntry

HEADER_KEY = SigningKey.from_seed(b"h" * 32)
WRITER = SigningKey.from_seed(b"w" * 32)
STRANGER = SigningKey.from_seed(b"s" * 32)
SYMMETRIC_KEY = b"k" * 24
SPACE = SpaceId(10)
PLACE = Location.from_number(1 << 100)
FOR_EVER = 2**64 - 1


def signed(header: SceneLogPublic, key: SigningKey = HEADER_KEY) -> SceneLogPublic:
    return replace(header, signature=key.sign(HEADER_DOMAIN, header.signable()))


def first_header(**changes: Any) -> SceneLogPublic:
    """A valid first header; `changes` are made before it gets its genesis and its signature."""
    header = SceneLogPublic(
        scene=SceneId(1),
        genesis=bytes(32),
        origin=NodeId(1),
        position=1,
        write_floor=0,
        mode=SceneMode.EDIT,
        spaces=(SpaceEntry(SPACE, SpaceId(0), FIRST, 1, 1, render_output=False, node_managed=False),),
        writers=(WriterEntry(WRITER.key_id, 0, FOR_EVER),),
        public_key=HEADER_KEY.key_id,
        private_key=KeyId(0),
        keys=tuple(KeyEntry(1, key.public.raw) for key in (HEADER_KEY, WRITER)),
    )
    header = replace(header, **changes)
    named = (entry.raw for entry in header.keys if key_id_of(entry.raw) == header.public_key)
    return signed(replace(header, first_key=next(named, HEADER_KEY.public.raw)).with_genesis())


def later_header(first: SceneLogPublic, key: SigningKey = HEADER_KEY, **changes: Any) -> SceneLogPublic:
    """A successor of `first`, signed anew."""
    return signed(replace(first, **{"position": first.position + 1, **changes}), key)


def sealed(scene: SceneLogPublic, key: SigningKey = WRITER, payload: bytes = b"payload", **changes: Any) -> Record:
    """A record of the scene by `key`."""
    fields: dict[str, Any] = {
        "scene": scene.scene,
        "genesis": scene.genesis,
        "space": SPACE,
        "location": PLACE,
        "epoch": scene.position,
        "seq": 1,
        "session": 1,
        "nonce": b"n" * 12,
    }
    return seal_record(payload, symmetric_key=SYMMETRIC_KEY, signing_key=key, **{**fields, **changes})


def offered(record: Record, **changes: Any) -> PutItem:
    """The record as it is offered to a node, for the place that its header says."""
    header = record.header
    item = PutItem(
        scene=header.scene,
        space=header.space,
        location=header.location,
        expect=None,
        signature=record.signature,
        header=record.header_bytes,
        ciphertext=record.ciphertext,
    )
    return replace(item, **changes)
