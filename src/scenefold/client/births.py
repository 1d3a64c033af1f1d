"""How a scene begins: its keys, and the public header that the cluster's nodes will know it by (consensus.md, §3).

Deterministic but for the keys, so that a creation that was interrupted after the keys were saved can announce
the very same scene again.
"""

from __future__ import annotations

from dataclasses import replace

from scenefold.base.errors import DamagedData
from scenefold.base.ids import KeyId, NodeId, SceneId
from scenefold.crypto import HEADER_DOMAIN, SUITES, PublicKey, SigningKey, key_id_of
from scenefold.scene.log import first_log, first_record, sign_record
from scenefold.wire import NO_GENESIS, KeyEntry, SceneLogPublic, SceneMode, SignedRecord, WriterEntry
from scenefold.world.keyring import SceneKeys

FIRST_POSITION = 1
_POSITION_MAX = 2**64 - 1


def born(name: str, symmetric_key: bytes, header_key: SigningKey, writer: PublicKey, origin: NodeId) -> SceneKeys:
    """The keyring entry of a new scene."""
    genesis = _first_header(header_key, writer, origin).genesis
    return SceneKeys(name=name, genesis=genesis, symmetric_key=symmetric_key, header_seed=header_key.seed)


def first_header(keys: SceneKeys, writer: PublicKey, origin: NodeId) -> SceneLogPublic | None:
    """The signed first header of a scene; None if these are not the writer and origin that it was born with."""
    header_key = SigningKey.from_seed(keys.header_seed)
    header = _first_header(header_key, writer, origin)
    if header.genesis != keys.genesis:
        return None
    return replace(header, signature=header_key.sign(HEADER_DOMAIN, header.signable()))


def first_records(keys: SceneKeys, origin: NodeId) -> tuple[SignedRecord, ...]:
    """The scene's log at its first position: the spaces that every scene has."""
    return (sign_record(first_record(keys.genesis, origin), SigningKey.from_seed(keys.header_seed)),)


def writers_of(header: SceneLogPublic) -> dict[KeyId, PublicKey]:
    """The keys of all writers that a header names in full."""
    named = {entry.key for entry in header.writers}
    keys = [PublicKey(entry.raw, entry.suite) for entry in header.keys if entry.suite in SUITES]
    return {key.key_id: key for key in keys if key.key_id in named}


def verify_header(header: SceneLogPublic, scene: SceneId, genesis: bytes, header_key: PublicKey | None = None) -> None:
    """DamagedData unless the header is of this scene and signed by its header key.

    A first header proves itself: its hash is the genesis. For a later one the key must be known.
    """
    where = f"scene {scene:08x}"
    if (header.scene, header.genesis) != (scene, genesis):
        raise DamagedData("a node answered with the header of another scene", where=where)
    if header_key is None:
        if header.with_genesis().genesis != genesis:
            raise DamagedData("the scene's header does not prove itself", where=where)
        header_key = header_key_of(header)
    header_key.verify(header.signature, HEADER_DOMAIN, header.signable())


def header_key_of(header: SceneLogPublic) -> PublicKey:
    """The key that a header says it is signed with; DamagedData if it does not hold it."""
    for entry in header.keys:
        if key_id_of(entry.raw) == header.public_key:
            return PublicKey(entry.raw, entry.suite)
    raise DamagedData("the scene's header does not hold its key", where=f"scene {header.scene:08x}")


def _first_header(header_key: SigningKey, writer: PublicKey, origin: NodeId) -> SceneLogPublic:
    keys = {key.key_id: key for key in (header_key.public, writer)}
    return SceneLogPublic(
        scene=SceneId(1),
        genesis=NO_GENESIS,
        origin=origin,
        position=FIRST_POSITION,
        write_floor=0,
        mode=SceneMode.EDIT,
        # The genesis, which is not known yet, changes nothing about the spaces of the first record.
        spaces=first_log(NO_GENESIS, origin).public_spaces(),
        writers=(WriterEntry(writer.key_id, 0, _POSITION_MAX),),
        public_key=header_key.key_id,
        private_key=KeyId(0),
        keys=tuple(KeyEntry(key.suite, key.raw) for key in keys.values()),
    ).with_genesis()
