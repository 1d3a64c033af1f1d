"""Lockboxes: a scene's keys, sealed to one member, in the header that everybody keeps (specs/04-records.md, Lockboxes).

All have the same length whatever is in them, so that nodes learn neither a member's role nor the scene's name. Whoever grants signs what
he seals: else a node could make up a scene for somebody whose public key it knows, and read what he writes there.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

from scenefold.base.errors import DamagedData
from scenefold.base.ids import KeyId
from scenefold.base.limits import MEMBER_NAME_BYTES_MAX
from scenefold.crypto import LOCKBOX_PURPOSE, SYMMETRIC_KEY_BYTES, PublicKey, SealingKey, SealingPublicKey, SigningKey
from scenefold.scene.log.keys import HEADER_SEED_BYTES, EpochKeys, SceneKeys
from scenefold.wire import KeyEntry, Lockbox, Role, SceneLogPublic

NAME_BYTES_MAX = 64
LOCKBOX_DOMAIN = b"scenefold/grant"
_VERSION = 1
_FORM = struct.Struct(f">BBI{SYMMETRIC_KEY_BYTES}s32s{HEADER_SEED_BYTES}sB{NAME_BYTES_MAX}sB{MEMBER_NAME_BYTES_MAX}s")
_NO_SEED = bytes(HEADER_SEED_BYTES)


@dataclass(frozen=True, slots=True)
class Contents:
    """What lies in a lockbox. `name`: of the scene; `granter`: of the owner who sealed it."""

    role: Role
    key_epoch: int
    symmetric_key: bytes = field(repr=False)
    header_key: PublicKey
    name: str
    granter: str
    header_seed: bytes | None = field(default=None, repr=False)

    def encode(self) -> bytes:
        name, granter = self.name.encode(), self.granter.encode()
        assert len(name) <= NAME_BYTES_MAX
        assert len(granter) <= MEMBER_NAME_BYTES_MAX
        keys = self.symmetric_key, self.header_key.raw, self.header_seed or _NO_SEED
        return _FORM.pack(_VERSION, self.role, self.key_epoch, *keys, len(name), name, len(granter), granter)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """DamagedData for anything that `encode` does not make."""
        if len(data) != _FORM.size or data[0] != _VERSION:
            raise DamagedData("a scene's lockbox has another form", remedy="update this program")
        _, role, key_epoch, symmetric_key, header_key, seed, size, name, granter_size, granter = _FORM.unpack(data)
        try:
            names = name[:size].decode(), granter[:granter_size].decode()
            found = cls(Role(role), key_epoch, symmetric_key, PublicKey(header_key), *names, seed if any(seed) else None)
        except ValueError:
            raise DamagedData("a scene's lockbox holds no role, or no name") from None
        if not all(name.isprintable() for name in names):
            raise DamagedData("a scene's lockbox holds a name that cannot be shown")
        if found.encode() != data or (found.role is Role.OWNER) != (found.header_seed is not None):
            raise DamagedData("a scene's lockbox is ill-formed")
        if found.header_seed is not None and SigningKey(found.header_seed).public != found.header_key:
            raise DamagedData("a scene's lockbox holds the seed of another header key")
        return found


def locked(contents: Contents, recipient: KeyEntry, genesis: bytes, granter: SigningKey, token: Callable[[int], bytes]) -> Lockbox:
    """The lockbox for the member with this sealing key, signed by its granter; `token` draws random bytes."""
    key = SealingPublicKey(recipient.raw, recipient.suite)
    context = _context(genesis, key.key_id, contents.key_epoch)
    sealed = key.seal(contents.encode(), LOCKBOX_PURPOSE, context, token)
    return Lockbox(key.key_id, sealed, granter.sign(LOCKBOX_DOMAIN, _signed(context, contents.header_key.raw, sealed)))


def check_granter(lockbox: Lockbox, contents: Contents, genesis: bytes, granter: PublicKey) -> None:
    """InvalidSignature unless this key's holder sealed these contents into this lockbox."""
    check_sealed_by(lockbox, genesis, contents.key_epoch, contents.header_key.raw, granter)


def check_sealed_by(lockbox: Lockbox, genesis: bytes, key_epoch: int, header_key: bytes, granter: PublicKey) -> None:
    """Likewise for who cannot open it: unless this key's holder says that it is of this scene, epoch and header key."""
    context = _context(genesis, lockbox.recipient, key_epoch)
    granter.verify(lockbox.signature, LOCKBOX_DOMAIN, _signed(context, header_key, lockbox.sealed))


def unlocked(lockbox: Lockbox, key: SealingKey, genesis: bytes, key_epoch: int) -> Contents:
    """What is in it; DamagedData if it is not this key's, for this scene and epoch."""
    contents = Contents.decode(key.open(lockbox.sealed, LOCKBOX_PURPOSE, _context(genesis, lockbox.recipient, key_epoch)))
    if contents.key_epoch != key_epoch:
        raise DamagedData("a scene's lockbox holds the key of another epoch")
    return contents


def own_lockbox(header: SceneLogPublic, key: SealingKey) -> tuple[Lockbox, Contents] | None:
    """What a header holds for this key, closed and opened; None if nothing. DamagedData if all that is addressed to it is damaged."""
    problem: DamagedData | None = None
    for lockbox in header.lockboxes:
        if lockbox.recipient == key.public.key_id:
            try:
                return lockbox, unlocked(lockbox, key, header.genesis, header.key_epoch)
            except DamagedData as damage:
                problem = damage
    if problem is not None:
        raise problem
    return None


def keys_in(contents: Contents, genesis: bytes) -> SceneKeys:
    """The keys in memory that a lockbox gives."""
    epochs = EpochKeys.only(contents.symmetric_key, contents.key_epoch)
    return SceneKeys(contents.name, genesis, epochs, contents.header_key, contents.role, contents.header_seed)


def _signed(context: bytes, header_key: bytes, sealed: bytes) -> bytes:
    return b"".join((context, header_key, sealed))


def _context(genesis: bytes, recipient: KeyId, key_epoch: int) -> bytes:
    return b"".join((genesis, recipient.to_bytes(4, "big"), key_epoch.to_bytes(4, "big")))
