"""Writes specs/vectors/scene_log.json: what any implementation of specs/16-scene-log.md must give.

    .venv/bin/python tools/make_scene_log_vectors.py

A log of six records, its hashes, the sealed bytes, the same with a snapshot, a decided header, what its spaces are then, where places lie, and lockboxes. The inputs are
fixed, signatures and cipher deterministic, so the file changes only when the format does. Floats are in hexadecimal.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from scenefold.base.ids import KeyId, NodeId, SceneId, SpaceId
from scenefold.base.location import FIRST
from scenefold.crypto import SealingKey, SigningKey
from scenefold.scene.log import (
    Contents,
    LoggedSpace,
    OpenedLog,
    SceneLog,
    cut_at,
    decided,
    first_record,
    locked,
    seal_private,
    sign_record,
    signed_header,
)
from scenefold.wire import (
    Batch,
    CreateSpace,
    CurveKind,
    Grant,
    KeyEntry,
    KeyEpoch,
    LogEntry,
    LogRecord,
    Revoke,
    Role,
    ScaleSpace,
    SceneLogPublic,
    SceneMode,
    TranslateSpace,
)

TARGET = Path(__file__).parents[1] / "specs" / "vectors" / "scene_log.json"
GENESIS = bytes(range(32))
ORIGIN = NodeId(0x7F000002)
HEADER_SEED = bytes(range(32, 64))
ORIGIN_SEED = bytes(range(64, 96))
SYMMETRIC_KEY = bytes(range(24))
NEW_SYMMETRIC_KEY = bytes(range(100, 124))
NONCE = bytes(range(12))
HALL, WIDE = SpaceId(11), SpaceId(12)
SNAPSHOT_AT = 4


def member(number: int, role: Role) -> Grant:
    """A member whose keys follow from a number."""
    signing, sealing = SigningKey(bytes([number]) * 32), SealingKey(bytes([number + 100]) * 32)
    return Grant(f"user:m{number}", role, KeyEntry(1, signing.public.raw), KeyEntry(1, sealing.public.raw))


def entries() -> list[LogEntry]:
    """What happens to the scene after its first record."""
    hall = CreateSpace(HALL, 3, CurveKind.HILBERT, False, SpaceId(0), FIRST, 1, 1, False, "hall", (0.0, -1.0, 2.0), (4.0, 3.0, 10.0))
    wide = CreateSpace(WIDE, 5, CurveKind.Z_ORDER, False, SpaceId(0), FIRST, 3, 2, True, "wide", (0.0,) * 5, (1.0,) * 5)
    return [
        Batch((hall, wide)),
        TranslateSpace(HALL, (1.0, 0.25, -2.0)),
        Batch((ScaleSpace(HALL, 0.1), TranslateSpace(WIDE, (0.1,) * 5), ScaleSpace(WIDE, 3.0))),
        member(2, Role.WRITER),
        Batch((Revoke(SigningKey(bytes([2]) * 32).key_id), KeyEpoch(1, SYMMETRIC_KEY))),
    ]


def records() -> list[LogRecord]:
    """The whole log."""
    made = [first_record(GENESIS, ORIGIN, member(1, Role.OWNER), copies=1)]
    for index, entry in enumerate(entries()):
        made.append(SceneLog.of(made).next_record(entry, bytes([index + 1]) * 16, ORIGIN))
    return made


def document() -> dict[str, Any]:
    """The file's content."""
    log = records()
    key = SigningKey.from_seed(HEADER_SEED)
    signed = [sign_record(record, key) for record in log]
    sealed = seal_private(signed, genesis=GENESIS, symmetric_key=NEW_SYMMETRIC_KEY, key_epoch=1, nonce=NONCE)
    state = SceneLog.of(log)
    return {
        "genesis": GENESIS.hex(),
        "header_seed": HEADER_SEED.hex(),
        "symmetric_key": NEW_SYMMETRIC_KEY.hex(),
        "nonce": NONCE.hex(),
        "records": [
            {"record": one.record.hex(), "signature": one.signature.hex(), "hash": log[i].hash().hex()} for i, one in enumerate(signed)
        ],
        "sealed": sealed.hex(),
        "shortened": shortened(OpenedLog(state, tuple(signed)), key),
        "lockbox": lockbox(key),
        "header": header(key, state, sealed),
        "places": [_places(state.space(space)) for space in (HALL, WIDE)],
    }


def shortened(log: OpenedLog, header_key: SigningKey) -> dict[str, Any]:
    """The same log with its first records in a snapshot."""
    short = cut_at(log, SNAPSHOT_AT, GENESIS, header_key)
    assert short.snapshot is not None
    sealed = seal_private(
        short.records, genesis=GENESIS, symmetric_key=NEW_SYMMETRIC_KEY, key_epoch=1, nonce=NONCE, snapshot=short.snapshot
    )
    return {
        "position": SNAPSHOT_AT,
        "state": short.snapshot.state.hex(),
        "signature": short.snapshot.signature.hex(),
        "sealed": sealed.hex(),
    }


def header(header_key: SigningKey, state: SceneLog, sealed: bytes) -> dict[str, Any]:
    """A header of the log's position, decided, with what gives its genesis. Not of the scene above, whose genesis is made up."""
    decider = SigningKey.from_seed(ORIGIN_SEED)
    first = SceneLogPublic(
        scene=SceneId(1),
        genesis=bytes(32),
        origin=ORIGIN,
        position=1,
        write_floor=0,
        mode=SceneMode.EDIT,
        spaces=state.public_spaces()[:2],
        writers=state.grants.writers[:1],
        public_key=header_key.key_id,
        private_key=KeyId(0),
        keys=(KeyEntry(1, header_key.public.raw), *state.grants.writer_keys[:1]),
        first_key=header_key.public.raw,
        origin_key=decider.public.raw,
    ).with_genesis()
    newest = replace(first, position=state.position, write_floor=state.write_floor, spaces=state.public_spaces(), key_epoch=1)
    newest = decided(signed_header(newest, sealed, header_key), decider)
    assert newest.decision is not None
    return {
        "origin_seed": ORIGIN_SEED.hex(),
        "first_key": newest.first_key.hex(),
        "origin_key": newest.origin_key.hex(),
        "birth": newest.birth.hex(),
        "genesis": newest.genesis.hex(),
        "log_hash": newest.log_hash.hex(),
        "signable": newest.signable().hex(),
        "signature": newest.signature.hex(),
        "certificate": newest.decision.certificates[0].hex(),
        "bytes": newest.encode().hex(),
    }


def lockbox(header_key: SigningKey) -> dict[str, Any]:
    """What the owner is given of the newest epoch, sealed with an ephemeral key of fixed bytes."""
    contents = Contents(Role.OWNER, 1, NEW_SYMMETRIC_KEY, header_key.public, "kitchen", "user:m1", header_key.seed)
    sealing = SealingKey(bytes([101]) * 32)
    sealed = locked(contents, KeyEntry(1, sealing.public.raw), GENESIS, SigningKey(bytes([1]) * 32), lambda count: bytes(range(count)))
    return {
        "sealing_seed": sealing.seed.hex(),
        "recipient": sealed.recipient,
        "key_epoch": 1,
        "contents": contents.encode().hex(),
        "sealed": sealed.sealed.hex(),
        "signature": sealed.signature.hex(),
    }


def _places(space: LoggedSpace) -> dict[str, Any]:
    low, high = space.world_box
    points = [[a + (b - a) * share for a, b in zip(low, high, strict=True)] for share in (0.0, 0.3, 0.5, 1.0)]
    locations = space.locations_of(points)
    return {
        "space": space.id,
        "factor": space.transform.factor.hex(),
        "offset": _floats(space.transform.offset),
        "world_low": _floats(low),
        "world_high": _floats(high),
        "positions": [_floats(point) for point in points],
        "locations": [location.hex() for location in locations],
        "centres": [_floats(row) for row in space.world_of(locations).tolist()],
        "centres_at_2": [_floats(row) for row in space.world_of(locations, at=2).tolist()],
        "fast_forward_from_3": [_floats(row) for row in space.fast_forward(points, 3).tolist()],
    }


def _floats(row: Any) -> list[str]:
    return [float(number).hex() for number in row]


if __name__ == "__main__":
    TARGET.write_text(json.dumps(document(), indent=1) + "\n", encoding="utf-8")
