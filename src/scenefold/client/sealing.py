"""Payloads to signed, encrypted records and back (storage.md, *Data packets*). Plain functions for a worker thread.

What a reader checks before it believes a record: that it is the record of this very scene, space and location,
that a writer whom the scene's header names signed it, that the ciphertext is the signed one, and that it opens
under the scene's key. Any of these failing is DamagedData naming the place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scenefold.base.errors import DamagedData
from scenefold.base.ids import KeyId, SceneId, SpaceId
from scenefold.base.location import Location
from scenefold.crypto import PublicKey, Record, RecordPlace, SigningKey, open_record, seal_record, verify_record
from scenefold.wire import PutItem, RecordBytes


@dataclass(frozen=True, slots=True)
class SceneIdentity:
    """Which scene, and the keys that its records verify and open with."""

    scene: SceneId
    genesis: bytes
    position: int
    """The committed log position that the header was read at: the Epoch of what is written."""
    writers: Mapping[KeyId, PublicKey]
    symmetric_key: bytes
    key_epoch: int


@dataclass(frozen=True, slots=True)
class Draft:
    """A record to be. `expect` as in PutItem."""

    space: SpaceId
    location: Location
    payload: bytes
    expect: bytes | None
    seq: int
    nonce: bytes


@dataclass(frozen=True, slots=True)
class Opened:
    """What a verified record holds, and its version."""

    payload: bytes
    seq: int
    digest: bytes


def seal_all(identity: SceneIdentity, writer: SigningKey, session: int, drafts: Sequence[Draft]) -> list[PutItem]:
    """Encrypt and sign every draft."""
    return [_seal(identity, writer, session, draft) for draft in drafts]


def open_all(
    identity: SceneIdentity, keys: Sequence[tuple[SpaceId, Location]], records: Sequence[RecordBytes | None]
) -> list[Opened | None]:
    """Verify and decrypt every record that is there."""
    return [
        None if record is None else _open(identity, space, location, record)
        for (space, location), record in zip(keys, records, strict=True)
    ]


def _seal(identity: SceneIdentity, writer: SigningKey, session: int, draft: Draft) -> PutItem:
    record = seal_record(
        scene=identity.scene,
        genesis=identity.genesis,
        space=draft.space,
        location=draft.location,
        epoch=identity.position,
        seq=draft.seq,
        session=session,
        content_position=identity.position,
        key_epoch=identity.key_epoch,
        payload=draft.payload,
        symmetric_key=identity.symmetric_key,
        signing_key=writer,
        nonce=draft.nonce,
    )
    return PutItem(
        identity.scene,
        draft.space,
        draft.location,
        draft.expect,
        record.signature,
        record.header_bytes,
        record.ciphertext,
    )


def _open(identity: SceneIdentity, space: SpaceId, location: Location, found: RecordBytes) -> Opened:
    where = f"scene {identity.scene:08x}, space {space}, {location.hex()}"
    record = Record(found.header, found.signature, found.ciphertext)
    try:
        claimed = record.header
        if claimed.genesis != identity.genesis:
            raise DamagedData("a node answered with the record of another scene")
        writer = identity.writers.get(claimed.writer)
        if writer is None:
            raise DamagedData(f"a record by key {claimed.writer:08x}, which is no writer of the scene")
        header = verify_record(record, writer, RecordPlace(identity.scene, space, location))
        return Opened(open_record(record, identity.symmetric_key), header.seq, header.digest)
    except DamagedData as error:
        raise DamagedData(error.what, where=where, remedy=error.remedy) from error
