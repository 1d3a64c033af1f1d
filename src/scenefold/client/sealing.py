"""Payloads to signed, encrypted records and back (storage.md, *Data packets*). Plain functions for a worker thread.

What a reader checks before it believes a record: that it is the record of this very scene, space and location,
that a writer whom the scene's header names signed it, that the ciphertext is the signed one, and that it opens
under the scene's key. Any of these failing is DamagedData naming the place. NewerThanKnown where a newer header may tell more.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from scenefold.base.errors import DamagedData, LocalFault, Refused
from scenefold.base.ids import KeyId, NodeId, SceneId, SpaceId
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.copies import check_no_shadow
from scenefold.client.tombstones import TOMBSTONE_BYTES_MAX, is_tombstone
from scenefold.client.verifying import Key, NewerThanKnown, WriterKey, newer, verified, writers_of
from scenefold.crypto import (
    EXPECTS_ANYTHING,
    PLACED_BY_CLIENT,
    PLACED_BY_NODE,
    UNKNOWN_DIGEST,
    RecordHeader,
    SigningKey,
    open_record,
    seal_records,
    signed_place,
)
from scenefold.crypto.record_header import TAG_BYTES, Version, version_key
from scenefold.scene.log import EpochKeys, Layouts
from scenefold.scene.payloads.splits import is_part
from scenefold.wire import PutItem, RecordBytes, SceneLogPublic, SceneMode


@dataclass(frozen=True, slots=True)
class SceneIdentity:
    """Which scene, and the keys that its records verify and open with."""

    scene: SceneId
    genesis: bytes
    position: int
    """The committed log position that the header was read at: the Epoch of what is written."""
    writers: Mapping[KeyId, WriterKey]
    keys: EpochKeys
    key_epoch: int | None = None
    """Of the key that new records are sealed under, as the header says; None: the newest of `keys`."""
    content_position: int | None = None
    """The log position that the coordinates in new payloads belong to; None: `position`."""
    mode: SceneMode = SceneMode.EDIT
    outputs: frozenset[SpaceId] = frozenset()
    """The spaces that renders write to: records of all others are edits."""
    write_floor: int = 0
    """The scene's newest change of mode does not lie above it (specs/26-modes.md)."""
    deciders: tuple[NodeId, ...] = ()
    """Who decides the scene's log, and lends leases of it; empty: the origin alone, and nobody needs leases."""
    node_managed: Mapping[SpaceId, bool] = field(default_factory=dict)
    """Of the known spaces: whether nodes choose where records lie."""
    layouts: Layouts = field(default_factory=partial(Layouts.of, ()))
    """Of the known spaces: which are shadows, whose records are the nodes' to keep, and where the copies of the others belong."""

    def with_header(self, header: SceneLogPublic, keys: EpochKeys | None = None) -> SceneIdentity:
        """The same scene as a newer header tells of it, with the keys that go with it. What payloads are written for stays as it was."""
        return replace(
            self,
            position=header.position,
            writers=writers_of(header),
            keys=self.keys if keys is None else keys,
            key_epoch=header.key_epoch,
            content_position=self.position if self.content_position is None else self.content_position,
            mode=header.mode,
            outputs=frozenset(entry.space for entry in header.spaces if entry.render_output),
            write_floor=header.write_floor,
            deciders=tuple(entry.member.node for entry in header.participants),
            node_managed={entry.space: entry.node_managed for entry in header.spaces},
            layouts=Layouts.of(header.spaces, header.scene),
        )

    @property
    def read_floor(self) -> int:
        """In render mode the write floor: who goes by a header below it may still take edits, and its answers are none for an image."""
        return self.write_floor if self.mode is SceneMode.RENDER else 0

    def is_edit(self, space: SpaceId) -> bool:
        """Whether a record of this space is an edit."""
        return space not in self.outputs

    def is_frozen(self, spaces: Iterable[SpaceId]) -> bool:
        """Whether the scene's mode forbids to write to one of these."""
        return self.mode is not SceneMode.EDIT and any(self.mode is SceneMode.ENDED or self.is_edit(space) for space in spaces)

    def check_mode(self, spaces: Iterable[SpaceId], name: str) -> None:
        """Refused (9) if it does. `name`: of the scene."""
        if self.is_frozen(spaces):
            if self.mode is SceneMode.ENDED:
                raise scene_ended(self.position, name)
            remedy = "switch it back to edit mode first"
            raise Refused(RejectReason.MODE_FORBIDS, "the scene is in render mode", where=f"scene {name}", remedy=remedy)

    def may_write(self, key: KeyId) -> bool:
        """Whether a record by this key would be taken now."""
        writer = self.writers.get(key)
        return writer is not None and writer.may_write_at(self.position)

    @property
    def sealing_key(self) -> tuple[int, bytes]:
        """Epoch and key of what is sealed now; Refused (17) if it is not given to us."""
        epoch = self.keys.newest_epoch if self.key_epoch is None else self.key_epoch
        key = self.keys.get(epoch)
        if key is None:
            raise key_withheld(f"scene {self.scene:08x}")
        return epoch, key

    def check_kind(self, space: SpaceId, object_id: bytes) -> None:
        """LocalFault for a record in a shadow, or with a place where nodes choose it, or the other way about."""
        check_no_shadow(self.layouts, space, "write to")
        is_managed = self.node_managed.get(space, bool(object_id))
        if is_managed and not object_id:
            remedy = "store it with put_managed, without a location"
            raise LocalFault("the nodes choose where records of this space lie", where=f"space {space}", remedy=remedy)
        if object_id and not is_managed:
            raise LocalFault("records of this space lie where you put them", where=f"space {space}", remedy="give a location or a position")


@dataclass(frozen=True, slots=True)
class Draft:
    """A record to be. `expect` as in Wish."""

    space: SpaceId
    location: Location
    payload: bytes = field(repr=False)
    expect: bytes | None
    seq: int
    nonce: bytes
    content_position: int | None = None
    """Where it differs from the scene's."""
    object: bytes = b""
    """Of a node-managed record: its id. `location` is then `signed_place` of it: the node chooses where it lies."""


@dataclass(frozen=True, slots=True)
class Opened:
    """What a verified record holds, and its version."""

    payload: bytes = field(repr=False)
    seq: int
    digest: bytes
    content_position: int = 0
    """The log position that the coordinates in the payload belong to."""
    key_epoch: int = 0
    version: Version = (0, 0, 0, 0, b"")
    """Its place in the order of all versions of the record."""

    @property
    def deleted(self) -> bool:
        """Whether this says that nothing lies here any more."""
        return is_tombstone(self.payload)


def scene_ended(position: int, name: str) -> Refused:
    """What is said of a scene that was ended at this position of its log."""
    what = f"the scene was ended at position {position} of its log, and the nodes let go of what it held"
    return Refused(RejectReason.MODE_FORBIDS, what, where=f"scene {name}", remedy="use another scene")


def payload_of(found: Opened | None) -> bytes | None:
    """What a reader is given: None for what is not there, or not any more."""
    return None if found is None or found.deleted else found.payload


def key_withheld(where: str) -> Refused:
    """The error for whoever does not hold the scene's key as it is now."""
    remedy = "ask an owner of the scene for access: `scenectl scene grant`"
    return Refused(RejectReason.KEY_REVOKED, "the scene's key was changed, and is not sealed to you", where=where, remedy=remedy)


def seal_all(identity: SceneIdentity, writer: SigningKey, session: int, drafts: Sequence[Draft]) -> list[PutItem]:
    """Encrypt and sign every draft."""
    key_epoch, symmetric_key = identity.sealing_key
    headers = [_header(identity, writer, session, key_epoch, draft) for draft in drafts]
    records = seal_records([(header, draft.payload) for header, draft in zip(headers, drafts, strict=True)], symmetric_key, writer)
    return [
        PutItem(identity.scene, draft.space, draft.location, record.signature, record.header_bytes, record.ciphertext)
        for draft, record in zip(drafts, records, strict=True)
    ]


def open_all(identity: SceneIdentity, keys: Sequence[Key], records: Sequence[RecordBytes | None]) -> list[Opened | None]:
    """Verify and decrypt every record that is there."""
    return [
        None if record is None else _open(identity, key[0], key[1], key[2] if len(key) == 3 else b"", record)
        for key, record in zip(keys, records, strict=True)
    ]


def are_sound(identity: SceneIdentity, keys: Sequence[Key], records: Sequence[RecordBytes]) -> list[bool | NewerThanKnown]:
    """Whether each is what a writer put there; of what may be newer than what is known, what is missing to tell."""
    return [_is_sound(identity, key, record) for key, record in zip(keys, records, strict=True)]


def _is_sound(identity: SceneIdentity, key: Key, record: RecordBytes) -> bool | NewerThanKnown:
    try:
        verified(identity, key[0], key[1], key[2] if len(key) == 3 else b"", record)
    except NewerThanKnown as missing:
        return missing
    except DamagedData:
        return False
    return True


def deleted_all(identity: SceneIdentity, keys: Sequence[Key], records: Sequence[RecordBytes | None]) -> list[bool]:
    """Whether each record is not there, or says that it is deleted. One that does not verify does not say so; NewerThanKnown is raised."""
    return [record is None or _is_deleted(identity, key, record) for key, record in zip(keys, records, strict=True)]


def unlisted_all(identity: SceneIdentity, keys: Sequence[Key], records: Sequence[RecordBytes | None]) -> list[bool]:
    """Whether each record is none to be listed: not there, deleted, or a part of a split one. Else as `deleted_all`; parts have any length."""
    return [record is None or _is_unlisted(identity, key, record) for key, record in zip(keys, records, strict=True)]


def _is_unlisted(identity: SceneIdentity, key: Key, record: RecordBytes) -> bool:
    try:
        found = _open(identity, key[0], key[1], key[2] if len(key) == 3 else b"", record)
    except NewerThanKnown:
        raise
    except DamagedData:
        return False
    return found.deleted or is_part(found.payload)


def _is_deleted(identity: SceneIdentity, key: Key, record: RecordBytes) -> bool:
    if len(record.ciphertext) > TOMBSTONE_BYTES_MAX + TAG_BYTES:
        return False
    try:
        return _open(identity, key[0], key[1], key[2] if len(key) == 3 else b"", record).deleted
    except NewerThanKnown:
        raise
    except DamagedData:
        return False


def _header(identity: SceneIdentity, writer: SigningKey, session: int, key_epoch: int, draft: Draft) -> RecordHeader:
    return RecordHeader(
        scene=identity.scene,
        genesis=identity.genesis,
        space=draft.space,
        location=signed_place(draft.object) if draft.object else draft.location,
        epoch=identity.position,
        seq=draft.seq,
        writer=writer.key_id,
        session=session,
        expects=_expects(draft.expect),
        content_position=_content_position(identity, draft),
        key_epoch=key_epoch,
        nonce=draft.nonce,
        length=len(draft.payload) + TAG_BYTES,
        digest=UNKNOWN_DIGEST,
        placement=PLACED_BY_NODE if draft.object else PLACED_BY_CLIENT,
        suite=writer.suite,
    )


def _expects(expect: bytes | None) -> bytes:
    """What the header says of an expectation; LocalFault if it is none."""
    if expect == EXPECTS_ANYTHING:
        # No record has this digest: whoever gives it means some version, and would replace any.
        raise LocalFault("a digest that no record has is expected", remedy="give that of the version to be replaced, or none")
    return EXPECTS_ANYTHING if expect is None else expect


def _content_position(identity: SceneIdentity, draft: Draft) -> int:
    if draft.content_position is not None:
        return draft.content_position
    return identity.position if identity.content_position is None else identity.content_position


def _open(identity: SceneIdentity, space: SpaceId, location: Location, object_id: bytes, found: RecordBytes) -> Opened:
    try:
        record = verified(identity, space, location, object_id, found)
        header = record.header
        key = identity.keys.get(header.key_epoch)
        if key is None:
            raise newer(f"the record is sealed under key epoch {header.key_epoch} of the scene", header.epoch, header.key_epoch)
        payload = open_record(record, key)
        return Opened(payload, header.seq, header.digest, header.content_position, header.key_epoch, version_key(header))
    except NewerThanKnown as error:
        error.where = _where(identity, space, location)
        raise
    except DamagedData as error:
        raise DamagedData(error.what, where=_where(identity, space, location), remedy=error.remedy) from error


def _where(identity: SceneIdentity, space: SpaceId, location: Location) -> str:
    return f"scene {identity.scene:08x}, space {space}, {location.hex()}"
