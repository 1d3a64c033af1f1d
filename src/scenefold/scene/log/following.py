"""From one position of a scene to the next: the header that goes with a record, and the keys that go with a header. Pure but for dice.

`follow` is the author's side, an owner's; `keys_after` everybody's who meets a newer header (specs/16-scene-log.md, Members).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from scenefold.base.errors import DamagedData, LocalFault, Refused
from scenefold.base.ids import KeyId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import (
    HEADER_DOMAIN,
    NONCE_BYTES,
    PublicKey,
    SealingKey,
    SigningKey,
    key_id_of,
    new_symmetric_key,
    open_former,
    seal_former,
)
from scenefold.scene.log.book import SceneLog
from scenefold.scene.log.bytes import OpenedLog, seal_private, sign_record
from scenefold.scene.log.decisions import check_decided, hash_of_log
from scenefold.scene.log.grants import Granted, newly_granted
from scenefold.scene.log.keys import HEADER_SEED_BYTES, EpochKeys, SceneKeys
from scenefold.scene.log.lockboxes import Contents, keys_in, locked, own_lockbox
from scenefold.scene.log.shortening import shortened
from scenefold.scene.log.succession import header_key_now, succeeded
from scenefold.wire import KeyEntry, Lockbox, LogRecord, Role, SceneLogPublic, digest_of_header

Token = Callable[[int], bytes]


@dataclass(frozen=True, slots=True)
class Followed:
    """A position that may be proposed, and the keys that its author has then. `private`: its log, sealed."""

    header: SceneLogPublic
    log: OpenedLog
    keys: SceneKeys
    private: bytes


@dataclass(frozen=True, slots=True)
class Draft:
    """The next position, all dice cast; what is left takes time with a long log, and belongs in a worker thread."""

    _header: SceneLogPublic
    _log: OpenedLog
    _keys: SceneKeys
    _signer: SigningKey
    _nonce: bytes

    def sealed(self) -> Followed:
        """The log sealed, shortened if it is long, and the header signed over it. LocalFault if it is too long all the same."""
        header, epoch = self._header, self._header.key_epoch
        try:
            log = shortened(self._log, header.genesis, self._signer)
            private = seal_private(
                log.records,
                genesis=header.genesis,
                symmetric_key=self._keys.epochs[epoch],
                key_epoch=epoch,
                nonce=self._nonce,
                snapshot=log.snapshot,
            )
        except LocalFault as problem:
            what, where = f"the scene's log has become too long: {problem.what}", f"scene {self._keys.name}, log position {header.position}"
            remedy = "put its content into a new scene, whose spaces are created where those of this one lie now"
            raise LocalFault(what, where=where, remedy=remedy) from problem
        return Followed(signed_header(header, private, self._signer), log, self._keys, private)


def signed_header(header: SceneLogPublic, private: bytes, signer: SigningKey) -> SceneLogPublic:
    """The header with the hash of its sealed log, signed with the scene's header key."""
    header = replace(header, log_hash=hash_of_log(private), decision=None)
    return replace(header, signature=signer.sign(HEADER_DOMAIN, header.signable()))


def follow(header: SceneLogPublic, log: OpenedLog, record: LogRecord, keys: SceneKeys, author: SigningKey, token: Token) -> Draft:
    """The next position. Refused if the record does not fit; LocalFault if the author is no owner.

    `author`: signs the lockboxes, so that whoever opens one for the first time knows by whose word.
    Where the record begins a key epoch, or takes an owner's role away, the new keys are drawn here.
    """
    seed = keys.header_seed
    if seed is None:
        raise LocalFault("these keys do not sign for the scene", where=f"scene {keys.name}", remedy="ask one of its owners")
    before, state = log.state, log.state.apply(record)
    former, epoch = header.former_keys, state.grants.key_epoch
    if epoch != before.grants.key_epoch:
        # Whatever is known for this epoch is of a log that was decided otherwise since, and others may know it.
        keys = replace(keys, epochs=EpochKeys({**keys.epochs, epoch: new_symmetric_key(token)}))
        key, nonce = keys.epochs[epoch], token(NONCE_BYTES)
        former = seal_former(state.grants.former_keys, genesis=header.genesis, key_epoch=epoch, symmetric_key=key, nonce=nonce)
    signer, succession = SigningKey.from_seed(seed), header.succession
    if state.grants.header_keyed_at != before.grants.header_keyed_at:
        heir = SigningKey.from_seed(token(HEADER_SEED_BYTES))
        succession = (*succession, succeeded(signer, heir.public, header.genesis, record.position))
        signer, keys = heir, replace(keys, header_key=heir.public, header_seed=heir.seed)
    # What participants decide says what was asked for, and what it follows.
    by_others = bool(before.roster.participants)
    public = replace(
        header,
        position=state.position,
        write_floor=max(state.write_floor, header.write_floor),
        purged=max(state.purged, header.purged),
        mode=state.mode,
        spaces=state.public_spaces(),
        writers=state.grants.writers,
        public_key=signer.key_id,
        keys=header_keys(signer.public, state),
        key_epoch=epoch,
        former_keys=former,
        lockboxes=_lockboxes(header, before, state, keys, author, token),
        succession=succession,
        participants=state.roster.participants,
        observers=state.roster.observers,
        request=record.request_id if by_others else b"",
        previous=digest_of_header(header) if by_others else b"",
    )
    grown = OpenedLog(state, (*log.records, sign_record(record, signer)), log.snapshot)
    return Draft(public, grown, keys, signer, token(NONCE_BYTES))


def header_keys(header_key: PublicKey, state: SceneLog) -> tuple[KeyEntry, ...]:
    """Every key that a header names: its own, and those of all who ever were writers. Refused for a writer's key with the id of the header's."""
    own = KeyEntry(header_key.suite, header_key.raw)
    if any(key_id_of(entry.raw) == header_key.key_id and entry != own for entry in state.grants.writer_keys):
        what, remedy = "a writer's key has the id of the scene's header key", "let that member make new keys"
        raise Refused(RejectReason.ILL_FORMED, what, where="scene log", remedy=remedy)
    return (own, *(entry for entry in state.grants.writer_keys if entry != own))


def lockbox_for(member: Granted, keys: SceneKeys, key_epoch: int, granter: str, author: SigningKey, token: Token) -> Lockbox:
    """What a member of this role is given of the scene's keys, by whom."""
    seed = keys.header_seed if member.role is Role.OWNER else None
    contents = Contents(member.role, key_epoch, keys.epochs[key_epoch], keys.header_key, keys.name, granter, seed)
    return locked(contents, member.sealing, keys.genesis, author, token)


def _lockboxes(
    header: SceneLogPublic, before: SceneLog, state: SceneLog, keys: SceneKeys, author: SigningKey, token: Token
) -> tuple[Lockbox, ...]:
    """In the order of the members; those whose contents stay are left as they are."""
    epoch = state.grants.key_epoch
    stay: dict[KeyId, Lockbox] = {}
    if epoch == before.grants.key_epoch:
        changed = {member.recipient for member in newly_granted(before.grants, state.grants)}
        stay = {lockbox.recipient: lockbox for lockbox in header.lockboxes if lockbox.recipient not in changed}
    owners = [member.name for member in before.grants.members if member.key == author.key_id and member.role is Role.OWNER]
    if not owners:
        raise LocalFault(
            "your signing key is none of an owner's", where=f"scene {keys.name}", remedy="use the keys that the scene was granted to"
        )
    (granter,) = owners
    return tuple(stay.get(member.recipient) or lockbox_for(member, keys, epoch, granter, author, token) for member in state.grants.members)


def keys_after(header: SceneLogPublic, keys: SceneKeys, sealing: SealingKey | None) -> SceneKeys:
    """The keys that whoever has `keys` has under a header; DamagedData if it is not signed by the scene's header key, Undecided if it was
    proposed, and no more.

    `sealing`: what its lockboxes are opened with. Whoever finds none there keeps what he has.
    """
    where = f"scene {header.scene:08x}"
    if (header.genesis, header.scene) != (keys.genesis, keys.scene_id):
        raise DamagedData("a node answered with the header of another scene", where=where)
    header_key = header_key_now(header, keys.header_key)
    header_key.verify(header.signature, HEADER_DOMAIN, header.signable())
    check_decided(header)
    # Opened each time: a node that decides a position twice may have shown us the other header of this epoch.
    found = None if sealing is None else own_lockbox(header, sealing)
    if found is None:
        seed = keys.header_seed if header_key == keys.header_key else None
        return _with_former(replace(keys, header_key=header_key, header_seed=seed), header)
    contents = found[1]
    if contents.header_key != header_key:
        raise DamagedData("a lockbox speaks of another header key than its header", where=where)
    given = keys_in(contents, keys.genesis)
    return _with_former(replace(given, name=keys.name, epochs=given.epochs.merged(keys.epochs)), header)


def _with_former(keys: SceneKeys, header: SceneLogPublic) -> SceneKeys:
    """With the keys of the epochs before the header's, if we have the one that they are sealed under. Where they differ from ours, the header's are right."""
    key = keys.epochs.get(header.key_epoch)
    if key is None or not header.former_keys:
        return keys
    former = open_former(header.former_keys, genesis=header.genesis, key_epoch=header.key_epoch, symmetric_key=key)
    return replace(keys, epochs=EpochKeys({**keys.epochs, **former}))


def keys_with_log(keys: SceneKeys, state: SceneLog) -> SceneKeys:
    """With the keys of the epochs before, which stand in the log. Where they differ from ours, the log's are right."""
    return replace(keys, epochs=EpochKeys({**keys.epochs, **state.grants.former_keys}))
