"""How a scene begins: its keys, and the public header that the cluster's nodes will know it by (consensus.md, §3).

Deterministic but for the keys and the maker's lockbox. Both are kept before the scene is announced, so that a creation that was
interrupted can announce the very same scene again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import KeyId, SceneId
from scenefold.base.limits import COPIES_MAX
from scenefold.client.copies import BY_DEFAULT, Copies
from scenefold.crypto import (
    HEADER_DOMAIN,
    MemberSecrets,
    PublicKey,
    SealingKey,
    SealingPublicKey,
    SigningKey,
    new_symmetric_key,
    nonce_from,
)
from scenefold.scene.log import (
    Decider,
    EpochKeys,
    SceneKeys,
    check_decided,
    first_log,
    first_record,
    header_keys,
    keys_in,
    lockbox_for,
    proven_header_key,
    seal_private,
    sign_record,
    signed_header,
    unlocked,
)
from scenefold.scene.log.roster import by_node
from scenefold.wire import NO_GENESIS, Grant, KeyEntry, ParticipantEntry, Role, SceneLogPublic, SceneMode, SignedRecord, pack_log
from scenefold.world.keyring import KeptScene

FIRST_POSITION = 1
FIRST_EPOCH = 0
_FIRST_NONCE = b"scenefold/first-nonce"
_SEED_BYTES = 32


def grant_of(name: str, role: Role, signing: PublicKey, sealing: SealingPublicKey) -> Grant:
    """The log entry that lets a member use a scene."""
    return Grant(name, role, KeyEntry(signing.suite, signing.raw), KeyEntry(sealing.suite, sealing.raw))


def maker_of(member: str, secrets: MemberSecrets) -> Grant:
    """The entry by which the maker of a scene is its first owner."""
    return grant_of(member, Role.OWNER, secrets.signing.public, secrets.sealing.public)


def born(
    name: str, maker: Grant, author: SigningKey, origin: Decider, token: Callable[[int], bytes], copies: Copies = BY_DEFAULT
) -> KeptScene:
    """A new scene: what its maker keeps of it. `author`: the maker's signing key; `token` draws random bytes (world.entropy.token).

    `copies`: of its first spaces.
    """
    header_key = SigningKey.from_seed(token(_SEED_BYTES))
    genesis = _first_header(header_key.public, maker, origin, copies).genesis
    epochs = EpochKeys.only(new_symmetric_key(token), FIRST_EPOCH)
    keys = SceneKeys(name, genesis, epochs, header_key.public, Role.OWNER, header_key.seed)
    owner = first_log(genesis, origin.node, maker, *copies).grants.named(maker.name)
    return KeptScene(name, genesis, header_key.key_id, FIRST_EPOCH, lockbox_for(owner, keys, FIRST_EPOCH, maker.name, author, token))


def kept_keys(kept: KeptScene, sealing: SealingKey) -> SceneKeys:
    """The keys that a keyring's entry gives to the user with this key; LocalFault if it is another user's."""
    try:
        keys = keys_in(unlocked(kept.lockbox, sealing, kept.genesis, kept.key_epoch), kept.genesis)
    except DamagedData as problem:
        remedy = "use the profile that made it, or restore the entry from a backup"
        raise LocalFault("the scene's keys are sealed to another user, or damaged", where=f"scene {kept.name}", remedy=remedy) from problem
    return replace(keys, name=kept.name)


def first_header(
    kept: KeptScene, keys: SceneKeys, maker: Grant, origin: Decider, participants: Sequence[ParticipantEntry] = ()
) -> SceneLogPublic | None:
    """The signed first header of a scene, as it is proposed; None if these are not the maker and origin that it was born with.

    `participants` decide what follows. The genesis does not cover them.
    """
    if keys.header_seed is None:
        return None
    copies = born_with(keys, maker, origin)
    if copies is None:
        return None
    header = _first_header(keys.header_key, maker, origin, copies)
    header = replace(header, lockboxes=(kept.lockbox,), participants=by_node(tuple(participants)))
    return signed_header(header, first_private(keys, maker, origin, participants), SigningKey.from_seed(keys.header_seed))


def first_records(
    keys: SceneKeys, maker: Grant, origin: Decider, participants: Sequence[ParticipantEntry] = ()
) -> tuple[SignedRecord, ...]:
    """The scene's log at its first position: the spaces that every scene has, its participants, and its maker."""
    assert keys.header_seed is not None
    copies = born_with(keys, maker, origin) or BY_DEFAULT
    record = first_record(keys.genesis, origin.node, maker, *copies, participants)
    return (sign_record(record, SigningKey.from_seed(keys.header_seed)),)


def first_private(keys: SceneKeys, maker: Grant, origin: Decider, participants: Sequence[ParticipantEntry] = ()) -> bytes:
    """That log, sealed; the same bytes each time, since the header names them.

    The nonce follows from all that is sealed, so another log gets another one: the genesis covers neither names nor layout of the first
    spaces, and a creation may be resumed by a later version, to which these are others. It is keyed, since a bare hash of the log
    would let nodes try names.
    """
    records, key = first_records(keys, maker, origin, participants), keys.epochs[FIRST_EPOCH]
    nonce = nonce_from(key, _FIRST_NONCE, keys.genesis + pack_log(records))
    return seal_private(records, genesis=keys.genesis, symmetric_key=key, key_epoch=FIRST_EPOCH, nonce=nonce)


def verified_header_key(header: SceneLogPublic) -> PublicKey:
    """The key that a header is signed with; DamagedData unless it leads back to the scene's genesis, and was decided."""
    key = proven_header_key(header)
    key.verify(header.signature, HEADER_DOMAIN, header.signable())
    check_decided(header)
    return key


def born_with(keys: SceneKeys, maker: Grant, origin: Decider) -> Copies | None:
    """How many copies the scene's first spaces have, which its genesis covers; None if these are not the maker and origin that it was born with."""
    # A keyring does not say it, and the creation may be resumed by a later version, with another default: so what can be is tried.
    every = (Copies(copies, least) for copies in range(1, COPIES_MAX + 1) for least in range(1, copies + 1))
    candidates = dict.fromkeys((BY_DEFAULT, *every))
    return next((copies for copies in candidates if _first_header(keys.header_key, maker, origin, copies).genesis == keys.genesis), None)


def _first_header(header_key: PublicKey, maker: Grant, origin: Decider, copies: Copies) -> SceneLogPublic:
    # The genesis, which is not known yet, changes nothing about what the first record says.
    state = first_log(NO_GENESIS, origin.node, maker, *copies)
    return SceneLogPublic(
        scene=SceneId(1),
        genesis=NO_GENESIS,
        origin=origin.node,
        position=FIRST_POSITION,
        write_floor=0,
        mode=SceneMode.EDIT,
        spaces=state.public_spaces(),
        writers=state.grants.writers,
        public_key=header_key.key_id,
        private_key=KeyId(0),
        keys=header_keys(header_key, state),
        first_key=header_key.raw,
        origin_key=origin.key,
    ).with_genesis()
