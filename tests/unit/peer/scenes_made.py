"""Scenes and records made from scratch, so that tests can bend one thing about them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from scenefold.base.ids import KeyId, NodeId, SceneId, SpaceId
from scenefold.base.location import FIRST, Location
from scenefold.crypto import HEADER_DOMAIN, PublicKey, Record, SealingKey, SigningKey, key_id_of, seal_record
from scenefold.scene.log import Contents, decided, hash_of_log, locked
from scenefold.wire import KeyEntry, Lockbox, PutItem, Role, SceneLogPublic, SceneMode, SpaceEntry, WriterEntry

HEADER_KEY = SigningKey.from_seed(b"h" * 32)
WRITER = SigningKey.from_seed(b"w" * 32)
STRANGER = SigningKey.from_seed(b"s" * 32)
MAKERS_SEALING_KEY = SealingKey(b"m" * 32)
SYMMETRIC_KEY = b"k" * 24
SPACE = SpaceId(10)
PLACE = Location.from_number(1 << 100)
FOR_EVER = 2**64 - 1
DECIDER = SigningKey.from_seed(b"d" * 32)
"""Of the node that decides all these scenes."""
LOG = b"the log, sealed"


def signed(header: SceneLogPublic, key: SigningKey = HEADER_KEY, decider: SigningKey = DECIDER) -> SceneLogPublic:
    """The header, signed by an owner and decided."""
    return decided(replace(header, signature=key.sign(HEADER_DOMAIN, header.signable())), decider)


def first_header(maker: SigningKey = WRITER, decider: SigningKey = DECIDER, **changes: Any) -> SceneLogPublic:
    """A valid first header; `changes` are made before it gets its genesis, its maker's lockbox and its signature."""
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
        origin_key=decider.public.raw,
        log_hash=hash_of_log(LOG),
    )
    header = replace(header, **changes)
    named = (entry.raw for entry in header.keys if key_id_of(entry.raw) == header.public_key)
    header = replace(header, first_key=next(named, HEADER_KEY.public.raw)).with_genesis()
    lockbox = header.lockboxes or (sealed_by(maker, header),)
    return signed(replace(header, lockboxes=lockbox), decider=decider)


def sealed_by(maker: SigningKey, header: SceneLogPublic) -> Lockbox:
    """The lockbox of who made the scene."""
    contents = Contents(Role.OWNER, header.key_epoch, SYMMETRIC_KEY, PublicKey(header.first_key), "scene", "user:maker", HEADER_KEY.seed)
    return locked(contents, KeyEntry(1, MAKERS_SEALING_KEY.public.raw), header.genesis, maker, lambda count: bytes(range(count)))


def later_header(
    first: SceneLogPublic, key: SigningKey = HEADER_KEY, decider: SigningKey = DECIDER, *, log: bytes = LOG, **changes: Any
) -> SceneLogPublic:
    """A successor of `first`, signed and decided anew."""
    return signed(replace(first, **{"position": first.position + 1, "log_hash": hash_of_log(log), **changes}), key, decider)


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
        signature=record.signature,
        header=record.header_bytes,
        ciphertext=record.ciphertext,
    )
    return replace(item, **changes)
