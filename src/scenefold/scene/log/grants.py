"""Who may use a scene, as its log says: members and roles, terms of writers, symmetric keys that were (specs/16-scene-log.md, Members).

Part of the fold: pure values, `Refused` (ILL_FORMED) for an entry that does not fit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from scenefold.base.errors import DamagedData, LocalFault, Refused
from scenefold.base.ids import KeyId
from scenefold.base.limits import HEADER_KEYS_MAX, WRITERS_PER_SCENE_MAX
from scenefold.base.reasons import RejectReason
from scenefold.crypto import PublicKey, SealingPublicKey, key_id_of
from scenefold.wire import Grant, KeyEntry, KeyEpoch, Revoke, Role, WriterEntry

FOR_EVER = 2**64 - 1
"""Where the term of a writer ends who was not revoked."""


@dataclass(frozen=True, slots=True)
class Granted:
    """A member that may use the scene; `position`: of the entry that gave it this role."""

    name: str
    role: Role
    signing: KeyEntry
    sealing: KeyEntry
    position: int

    @property
    def key(self) -> KeyId:
        """The id of its signing key."""
        return key_id_of(self.signing.raw)

    @property
    def recipient(self) -> KeyId:
        """The id of its sealing key."""
        return key_id_of(self.sealing.raw)


def _no_keys() -> Mapping[int, bytes]:
    return MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Grants:
    """`members` in the order of their grants."""

    members: tuple[Granted, ...] = ()
    writers: tuple[WriterEntry, ...] = ()
    """Every term that there was, in the order of their beginnings."""
    writer_keys: tuple[KeyEntry, ...] = ()
    """The keys of all who ever were writers, each once: their records are verified for as long as they lie there."""
    key_epoch: int = 0
    keyed_at: int = 1
    """The position of the newest KeyEpoch."""
    header_keyed_at: int = 1
    """From this position on the header key is another: an owner was revoked."""
    header_keys: int = 0
    """How often it changed."""
    revoked_at: int = 0
    former_keys: Mapping[int, bytes] = field(default_factory=_no_keys, repr=False)
    """The symmetric keys of the epochs before."""

    def named(self, name: str) -> Granted:
        """The member of this name; LocalFault if it may not use the scene."""
        for member in self.members:
            if member.name == name:
                return member
        known = ", ".join(member.name for member in self.members)
        raise LocalFault(f"{name} has no access to the scene", where="member", remedy=f"those who have: {known}")

    def granted(self, entry: Grant, position: int) -> Grants:
        """With one more member, or a member in a higher role."""
        if not entry.name:
            raise _ill_formed("a member needs a name")
        member = Granted(entry.name, entry.role, entry.signing, entry.sealing, position)
        before = next((other for other in self.members if other.name == entry.name), None)
        if before is None:
            self._check_new(member)
            if len(self.members) >= WRITERS_PER_SCENE_MAX:
                raise _ill_formed(f"a scene has at most {WRITERS_PER_SCENE_MAX} members", "revoke one first")
        else:
            if (before.signing, before.sealing) != (entry.signing, entry.sealing):
                raise _ill_formed(f"{entry.name} has access with other keys", f"revoke {entry.name} first")
            if entry.role <= before.role:
                raise _ill_formed(f"{entry.name} has that access already, or more", f"to take some of it away, revoke {entry.name} first")
        members = tuple(member if other is before else other for other in self.members) if before else (*self.members, member)
        grants = replace(self, members=members)
        if entry.role < Role.WRITER or (before is not None and before.role >= Role.WRITER):
            return grants
        return grants._with_writer(member)

    def revoked(self, entry: Revoke, position: int) -> Grants:
        """Without a member; its term as a writer ended before this position."""
        gone = next((member for member in self.members if member.key == entry.key), None)
        if gone is None:
            raise _ill_formed(f"no member has the key {entry.key:08x}")
        members = tuple(member for member in self.members if member is not gone)
        header_keyed_at, header_keys = self.header_keyed_at, self.header_keys
        if gone.role is Role.OWNER:
            if not any(member.role is Role.OWNER for member in members):
                raise _ill_formed("a scene keeps at least one owner", "grant somebody else that role first")
            if header_keyed_at != position:
                header_keyed_at, header_keys = position, header_keys + 1
            if header_keys > HEADER_KEYS_MAX:
                raise _ill_formed(f"the scene has had {HEADER_KEYS_MAX} header keys", "copy its content to a new scene")
        writers = tuple(
            replace(term, until_position=position - 1) if term.key == entry.key and term.until_position == FOR_EVER else term
            for term in self.writers
        )
        return replace(
            self, members=members, writers=writers, header_keyed_at=header_keyed_at, header_keys=header_keys, revoked_at=position
        )

    def rekeyed(self, entry: KeyEpoch, position: int) -> Grants:
        """With the next epoch's key in force."""
        if entry.epoch != self.key_epoch + 1 or self.keyed_at == position:
            raise _ill_formed(f"key epoch {entry.epoch} does not follow epoch {self.key_epoch}")
        former = MappingProxyType({**self.former_keys, self.key_epoch: entry.previous})
        return replace(self, key_epoch=entry.epoch, keyed_at=position, former_keys=former)

    def check_whole(self, position: int) -> None:
        """Refused if the record at `position` revoked somebody and left him the key."""
        if self.revoked_at == position and self.keyed_at != position:
            raise _ill_formed("whoever is revoked keeps the scene's key unless it changes in the same record")

    def _check_new(self, member: Granted) -> None:
        try:
            PublicKey(member.signing.raw, member.signing.suite)
            SealingPublicKey(member.sealing.raw, member.sealing.suite)
        except DamagedData as problem:
            raise _ill_formed(f"the keys of {member.name}: {problem.what}") from problem
        if any(member.key == other.key or member.recipient == other.recipient for other in self.members):
            raise _ill_formed(f"another member has a key of {member.name}")
        if any(key_id_of(entry.raw) == member.key and entry != member.signing for entry in self.writer_keys):
            raise _ill_formed("another key has this id already", "let the member make new keys")

    def _with_writer(self, member: Granted) -> Grants:
        keys = self.writer_keys if member.signing in self.writer_keys else (*self.writer_keys, member.signing)
        # One place is the header key's.
        if len(keys) >= WRITERS_PER_SCENE_MAX or len(self.writers) >= WRITERS_PER_SCENE_MAX:
            raise _ill_formed(f"a scene has had {WRITERS_PER_SCENE_MAX - 1} writers at most", "copy its content to a new scene")
        return replace(self, writers=(*self.writers, WriterEntry(member.key, member.position, FOR_EVER)), writer_keys=keys)


def newly_granted(before: Grants, after: Grants) -> Iterable[Granted]:
    """Members that `after` gives more than `before` did."""
    return (member for member in after.members if member not in before.members)


def _ill_formed(what: str, remedy: str = "") -> Refused:
    return Refused(RejectReason.ILL_FORMED, what, where="scene log", remedy=remedy)
