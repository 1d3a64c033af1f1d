"""Who may use a scene: granting, revoking, new keys (specs/16-scene-log.md, Members). All of it is an owner's to do.

Each is one entry of the scene's log, made from what the log says at that moment. The keys go to members in the lockboxes of the
header that goes with it; whoever is granted something needs to do nothing but open the scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

from scenefold.base.errors import LocalFault, Refused, UsageFault
from scenefold.client.access import SceneAccess
from scenefold.client.births import grant_of
from scenefold.client.requests import Again
from scenefold.crypto import Card
from scenefold.scene.log import Granted, SceneLog
from scenefold.wire import Batch, KeyEpoch, Revoke, Role

USER = "user:"
ROLES = {role.name.lower(): role for role in Role}


@dataclass(frozen=True, slots=True)
class Access:
    """Who may use a scene, and which of its keys is in force."""

    members: tuple[Granted, ...]
    key_epoch: int
    position: int

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        members = [
            {
                "name": member.name,
                "role": member.role.name.lower(),
                "since": member.position,
                "signing_key": f"{member.key:08x}",
                "sealing_key": f"{member.recipient:08x}",
            }
            for member in self.members
        ]
        return {"members": members, "key_epoch": self.key_epoch, "position": self.position}


def role_named(name: str) -> Role:
    """UsageFault if there is no such role."""
    role = ROLES.get(name)
    if role is None:
        raise UsageFault(f"there is no role {name!r}", where="role", remedy=f"choose one of {', '.join(ROLES)}")
    return role


async def access_of(access: SceneAccess) -> Access:
    """As the newest log says."""
    return _access(await _state(access))


async def grant(access: SceneAccess, card: Card, role: Role, *, again: Again = None) -> Access:
    """Let the holder of a card, which the caller has verified (as `card_for` does), use the scene; or give a member a higher role.

    LocalFault if he has that role or a higher one, or has access with other keys, and for a node that shall be an owner: those who open
    a scene for the first time believe the word of users.
    """
    if role is Role.OWNER and not card.name.startswith(USER):
        remedy = "make it a reader or a writer"
        raise LocalFault("only users can own a scene", where=card.name, remedy=remedy)
    entry = grant_of(card.name, role, card.keys.signing, card.keys.sealing)
    return _access((await access.change_log(lambda _: entry, again=again)).state)


async def revoke(access: SceneAccess, name: str, *, again: Again = None) -> Access:
    """End a member's access. The scene gets a new key, which he has not; what lies under older ones he may have read already.

    LocalFault if there is no such member, or it is the last owner.
    """
    return _access((await access.change_log(partial(_revocation, access, name), again=again)).state)


async def plan_revoke(access: SceneAccess, name: str) -> Access:
    """What `revoke` would leave, if nobody changes anything meanwhile; LocalFault where it would be one. Nothing is changed."""
    read = await access.read_log()
    await access.log_or_fault().owner()
    log = read.state
    try:
        request_id = access.calls.world.entropy.token(16)
        return _access(log.apply(log.next_record(_revocation(access, name, log), request_id, read.header.origin)))
    except Refused as refusal:
        raise LocalFault(refusal.what, where=f"scene {access.name}", remedy=refusal.remedy) from refusal


def _revocation(access: SceneAccess, name: str, log: SceneLog) -> Batch:
    return Batch((Revoke(log.grants.named(name).key), _next_epoch(access, log)))


async def rotate_key(access: SceneAccess, *, again: Again = None) -> Access:
    """Begin a new key epoch: from now on everything is sealed under a new key."""
    return _access((await access.change_log(lambda log: _next_epoch(access, log), again=again)).state)


def _next_epoch(access: SceneAccess, log: SceneLog) -> KeyEpoch:
    assert access.log is not None
    epoch = log.grants.key_epoch
    # The log was read a moment ago, so its key is among those that we have.
    return KeyEpoch(epoch + 1, access.log.keys.epochs[epoch])


async def _state(access: SceneAccess) -> SceneLog:
    return (await access.read_log()).state


def _access(log: SceneLog) -> Access:
    return Access(log.grants.members, log.grants.key_epoch, log.position)
