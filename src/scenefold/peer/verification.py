"""May this record be stored here? (Algorithm 6; specs/18-data.md, Writes). Pure; runs in the crypto lane.

In this order, cheapest first: the header is that of the place it is offered for, and of the scene with this genesis;
its epoch is not below the write floor; the scene's public header lists the writer for that epoch; the signature and
the digest of the ciphertext are right. Nothing here needs the scene's key: a node cannot read what it stores.

Copies that another node hands over are verified alike, but for the write floor: they were accepted once, and must
be movable in every mode.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import KeyId, SceneId, SpaceId
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import (
    PLACED_BY_NODE,
    SUITES,
    IllFormedRecord,
    PublicKey,
    Record,
    RecordHeader,
    RecordPlace,
    claimed_epoch,
    object_of,
    signed_place,
    verify_record,
    wanted_place,
)
from scenefold.store import Put
from scenefold.wire import HandItem, PutItem, SceneLogPublic, WriterEntry

Item = TypeVar("Item", PutItem, HandItem)


@dataclass(frozen=True, slots=True)
class KnownScene:
    """A verified public header, with its keys unpacked once."""

    public: SceneLogPublic
    keys: Mapping[KeyId, PublicKey]
    writers: Mapping[KeyId, Sequence[WriterEntry]]
    spaces: frozenset[SpaceId]
    managed: frozenset[SpaceId]
    """Those of them in which nodes choose the places."""

    @classmethod
    def of(cls, public: SceneLogPublic) -> KnownScene:
        # Who writes with a suite of a later program is none of our writers yet; all others go on.
        keys = {key.key_id: key for key in (PublicKey(entry.raw, entry.suite) for entry in public.keys if entry.suite in SUITES)}
        writers: dict[KeyId, list[WriterEntry]] = {}
        for entry in public.writers:
            writers.setdefault(entry.key, []).append(entry)
        managed = frozenset(entry.space for entry in public.spaces if entry.node_managed)
        return cls(public, keys, writers, frozenset(entry.space for entry in public.spaces), managed)

    def writer_key(self, header: RecordHeader) -> PublicKey:
        """The key of the header's writer, if it may write at the header's epoch; Refused otherwise."""
        entries = self.writers.get(header.writer, ())
        key = self.keys.get(header.writer)
        if key is None or not entries:
            raise Refused(RejectReason.NOT_AUTHORISED, f"key {header.writer:08x} is no writer of the scene")
        if not any(entry.from_position <= header.epoch <= entry.until_position for entry in entries):
            raise Refused(RejectReason.KEY_REVOKED, f"key {header.writer:08x} may not write at position {header.epoch}")
        return key


def verified_put(item: PutItem, scene: KnownScene) -> Put:
    """The record to be stored; Refused with the reason why it must not be."""
    record = Record(header_bytes=item.header, signature=item.signature, ciphertext=item.ciphertext)
    header = _verified(record, item, scene)
    if header.placement != PLACED_BY_NODE and header.space in scene.managed:
        # Not asked of copies: an early version let such records in, and they must be movable.
        raise Refused(RejectReason.ILL_FORMED, "nodes choose the places in this space, and the record names one")
    if header.epoch < scene.public.write_floor:
        raise Refused(RejectReason.MODE_FORBIDS, "the record's epoch is below the scene's write floor")
    return Put(record, item.expect)


def verified_copy(item: HandItem, scene: KnownScene) -> Put:
    """A record that another node hands over; Refused with the reason why it must not be kept."""
    record = Record(header_bytes=item.header, signature=item.signature, ciphertext=item.ciphertext)
    header = _verified(record, item, scene)
    if item.object != object_of(header):
        raise Refused(RejectReason.ILL_FORMED, "the record is that of another object")
    return Put(record, at=item.location if item.object else None)


def home_of(item: PutItem | HandItem) -> Location:
    """The place whose owner decides about a record: its own, or the one that its object id names. Looks at the header's bytes only."""
    try:
        header = RecordHeader.decode(item.header)
    except IllFormedRecord:
        return item.location
    object_id = object_of(header)
    return wanted_place(object_id) if object_id else item.location


def _verified(record: Record, item: PutItem | HandItem, scene: KnownScene) -> RecordHeader:
    try:
        header = record.header
        _check_scene(header, scene)
        # Where a node-managed record lies is no business of its writer, so it is no part of what is signed.
        signed_place = header.location if header.placement == PLACED_BY_NODE else item.location
        return verify_record(record, scene.writer_key(header), RecordPlace(item.scene, item.space, signed_place))
    except IllFormedRecord as problem:
        raise Refused(RejectReason.ILL_FORMED, str(problem)) from problem
    except DamagedData as problem:
        raise Refused(RejectReason.SIGNATURE_INVALID, str(problem)) from problem


def _check_scene(header: RecordHeader, scene: KnownScene) -> None:
    if header.genesis != scene.public.genesis:
        raise Refused(RejectReason.ILL_FORMED, "the signed header is that of another scene")
    if header.space not in scene.spaces:
        if header.epoch > scene.public.position:
            # The author may know of a space that this node will hear of: nothing definite can be said.
            raise Refused(RejectReason.NOT_READY, f"the scene's header of position {header.epoch} is not here yet")
        raise Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, f"the scene has no space {header.space}")
    if header.placement == PLACED_BY_NODE and (header.location != signed_place(object_of(header)) or not any(header.location)):
        raise Refused(RejectReason.ILL_FORMED, "a node-managed record names a place, or no object")


def epochs_of(items: Iterable[PutItem | HandItem]) -> dict[SceneId, int]:
    """The scenes of these records, in order, each with the highest log position that one of their authors claims to know.

    Asking for the scene at that position brings the header in which a new space or writer stands, if a push was missed. Who
    claims too much costs a round of asking a second at most, and is refused all the same.
    """
    epochs: dict[SceneId, int] = {}
    for item in items:
        epochs[item.scene] = max(epochs.get(item.scene, 0), claimed_epoch(item.header))
    return dict(sorted(epochs.items()))


def verify_all(claims: Sequence[tuple[PutItem, KnownScene]]) -> list[Put | Refused]:
    """Each item of its scene: the put, or why not. Some 60 microseconds an item."""
    return [_verdict(verified_put, item, scene) for item, scene in claims]


def verify_copies(claims: Sequence[tuple[HandItem, KnownScene]]) -> list[Put | Refused]:
    """The same for records that another node hands over."""
    return [_verdict(verified_copy, item, scene) for item, scene in claims]


def _verdict(verify: Callable[[Item, KnownScene], Put], item: Item, scene: KnownScene) -> Put | Refused:
    try:
        return verify(item, scene)
    except Refused as refusal:
        return refusal
