"""May this record be stored here? (Algorithm 6; specs/11-peers.md, Verification). Pure; runs in the crypto lane.

In this order, cheapest first: the header is that of the place it is offered for, and of the scene with this genesis;
its epoch is not below the write floor; the scene's public header lists the writer for that epoch; the signature and
the digest of the ciphertext are right. Nothing here needs the scene's key: a node cannot read what it stores.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import KeyId, SpaceId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import IllFormedRecord, PublicKey, Record, RecordHeader, RecordPlace, verify_record
from scenefold.store import Put
from scenefold.wire import PutItem, SceneLogPublic, WriterEntry


@dataclass(frozen=True, slots=True)
class KnownScene:
    """A verified public header, with its keys unpacked once."""

    public: SceneLogPublic
    keys: Mapping[KeyId, PublicKey]
    writers: Mapping[KeyId, Sequence[WriterEntry]]
    spaces: frozenset[SpaceId]

    @classmethod
    def of(cls, public: SceneLogPublic) -> KnownScene:
        keys = {key.key_id: key for key in (PublicKey(entry.raw) for entry in public.keys)}
        writers: dict[KeyId, list[WriterEntry]] = {}
        for entry in public.writers:
            writers.setdefault(entry.key, []).append(entry)
        return cls(public, keys, writers, frozenset(entry.space for entry in public.spaces))

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
    try:
        header = record.header
        _check_scene(header, scene)
        verify_record(record, scene.writer_key(header), RecordPlace(item.scene, item.space, item.location))
    except IllFormedRecord as problem:
        raise Refused(RejectReason.ILL_FORMED, str(problem)) from problem
    except DamagedData as problem:
        raise Refused(RejectReason.SIGNATURE_INVALID, str(problem)) from problem
    return Put(record, item.expect)


def _check_scene(header: RecordHeader, scene: KnownScene) -> None:
    if header.space not in scene.spaces:
        raise Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, f"the scene has no space {header.space}")
    if header.genesis != scene.public.genesis:
        raise Refused(RejectReason.ILL_FORMED, "the signed header is that of another scene")
    if header.epoch < scene.public.write_floor:
        raise Refused(RejectReason.MODE_FORBIDS, "the record's epoch is below the scene's write floor")


def verify_all(claims: Sequence[tuple[PutItem, KnownScene | None]]) -> list[Put | Refused]:
    """Each item of its scene, which must be known: the put, or why not. Some 60 microseconds an item."""
    return [_verdict(item, scene) for item, scene in claims]


def _verdict(item: PutItem, scene: KnownScene | None) -> Put | Refused:
    assert scene is not None
    try:
        return verified_put(item, scene)
    except Refused as refusal:
        return refusal
