"""`scenectl cluster invite`, `invitations`, `users`, `revoke`, `renew`: who belongs to a cluster."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from scenectl.member_values import Duration, DurationOption, MemberOption, shown_member
from scenectl.names import UserName
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, emit_event, table
from scenectl.values import DEFAULT_SUITE, AddressOption, SuiteOption

if TYPE_CHECKING:
    from scenefold.client.membership import Revoked, Roll
    from scenefold.crypto import Token
    from scenefold.world.roll import Invitation

ID_DIGITS = 16
AN_HOUR = Duration(3600)


def invite(
    *,
    node: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    address: AddressOption | None = None,
    user: UserName | None = None,
    admin: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    expires: DurationOption = AN_HOUR,
    find: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    withdraw: str | None = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Print a token that lets one node or one user join, once. Only administrators may.

    Hand it over as you would a password: whoever uses it first is the member.

    Example: scenectl cluster invite --user ada --profile studio

    Parameters
    ----------
    node
        The token is for a node.
    address
        IPv4 address that the node must have; by default any. Naming it lets a node come back under new keys.
    user
        The token is for a user of this name.
    admin
        The user may invite and revoke others.
    expires
        How long the token may be used: 30m, 1h, 2d.
    find
        The token names no nodes, and is shorter: who joins looks for them on the local network.
    withdraw
        Instead of all this: the id of an open invitation that shall count no longer.
    """
    from scenectl.running import connected, run
    from scenefold.base.errors import UsageFault
    from scenefold.base.ids import node_id_of
    from scenefold.wire.enrol_entries import ANY_NODE

    if withdraw is not None:
        _withdraw(withdraw, output)
        return
    is_node = node or address is not None
    if is_node == (user is not None):
        raise UsageFault("a token is for a node or for a user", where="scenectl cluster invite", remedy="give --node, or --user NAME")
    if admin and is_node:
        raise UsageFault("only a user can be an administrator", where="--admin", remedy="leave it out, or give --user NAME")
    name = f"user:{user}" if user is not None else ANY_NODE if address is None else f"node:{node_id_of(address.text)}"

    async def work() -> Token:
        async with connected(output.profile) as cluster:
            return await cluster.membership.invite(name, seconds=expires.seconds, is_administrator=admin, addresses=() if find else None)

    token = run(work)
    until = _time(token.expires)
    document = {"token": token.word(), "id": _id(token.key.public.raw), "name": name, "expires": until}
    whom = "a node" if name == ANY_NODE else f"the node {address}" if is_node else f"the user {user}"
    emit(output, document, f"{token.word()}\n\nFor {whom}, once, until {until}: scenectl cluster join TOKEN")


def joined_by_token(text: str, address: str | None, suite: SuiteOption, output: ProfileOutput) -> tuple[Path, str | None]:
    """Enrol by a token and say so; the profile, and the address of the node that may run now (None: it was a user)."""
    from scenectl.running import run
    from scenefold.base.errors import UsageFault
    from scenefold.base.ids import NodeId, address_of, node_id_of
    from scenefold.client.connecting import profile_place
    from scenefold.client.enrolling import check_is_here, enrol, enrol_here
    from scenefold.crypto import InvitedKind, Token, suite_named
    from scenefold.world.profile import ClusterProfile

    token, folder = Token.read(text), profile_place(output.profile)
    is_user = token.kind is InvitedKind.USER and address is None
    if suite != DEFAULT_SUITE and not is_user:
        raise UsageFault(f"a node's keys are of {DEFAULT_SUITE}", where="--suite", remedy="leave it out")

    async def work() -> tuple[ClusterProfile, NodeId]:
        if is_user:
            return await enrol(folder, token, suite=suite_named(suite).number), NodeId(0)
        if address is None:
            return await enrol_here(folder, token)
        node = node_id_of(address)
        check_is_here(node, token.high)
        return await enrol(folder, token, node), node

    profile, node = run(work)
    own = address_of(node) if node else None
    name = own or profile.user
    document = {"event": "enrolled", "cluster": profile.name, "name": name, "profile": str(profile.folder)}
    who = f"Node {own}" if own else f"User {profile.user}"
    emit_event(output, document, f"{who} is enrolled in {profile.name}; its keys are in {profile.folder}.")
    return profile.folder, own


def _withdraw(invitation: str, output: ProfileOutput) -> None:
    from scenectl.running import connected, run
    from scenefold.base.errors import UsageFault

    try:
        key = bytes.fromhex(invitation)
    except ValueError:
        key = b""
    if not key:  # With which all ids begin.
        raise UsageFault(f"{invitation!r} is no id of an invitation", where="--withdraw", remedy="see `scenectl cluster invitations`")

    async def work() -> None:
        async with connected(output.profile) as cluster:
            await cluster.membership.withdraw(key)

    run(work)
    emit(output, {"withdrawn": invitation}, f"Invitation {invitation} counts no longer.")


def invitations(*, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """List the invitations: for whom, by whom, until when, and whether they were used.

    Example: scenectl cluster invitations --profile studio
    """
    import time

    found, now = _roll(output).invitations, time.time()
    documents = [
        {
            "id": _id(one.entry.key),
            "name": one.entry.name,
            "admin": one.entry.is_administrator,
            "by": one.entry.by,
            "expires": _time(one.entry.expires),
            "state": _state(one, now),
        }
        for one in found
    ]
    rows = [
        (one["id"], shown_member(str(one["name"])), "yes" if one["admin"] else "no", one["by"], one["expires"], one["state"])
        for one in documents
    ]
    emit(output, {"invitations": documents}, table(("id", "for", "admin", "by", "until", "state"), rows))


def users(*, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """List the users: what they may do, their signing key's id, until when their certificate counts.

    Example: scenectl cluster users --profile studio
    """
    found = _roll(output)
    documents = [
        {
            "name": card.name.removeprefix("user:"),
            "admin": card.keys.is_administrator,
            "key": f"{card.signing_id:08x}",
            "not_after": f"{card.not_after:%Y-%m-%d}",
        }
        for card in found.users
    ]
    rows = [(one["name"], "yes" if one["admin"] else "no", one["key"], one["not_after"]) for one in documents]
    revoked = [name for name in found.revoked if name.startswith("user:")]
    note = f"\n\nrevoked: {', '.join(revoked)}" if revoked else ""
    emit(output, {"users": documents, "revoked": revoked}, table(("user", "admin", "key", "certificate until"), rows) + note)


def revoke(who: MemberOption, /, *, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Let the keys of a member count no longer, anywhere in the cluster, at once. A node is taken off the line.

    If it fails half-way, give it again. What the member has read, and the keys of scenes that it was given, it may have kept: see `scene revoke`.

    Example: scenectl cluster revoke user:ada --profile studio

    Parameters
    ----------
    who
        user:NAME, node:ADDRESS or node:ID.
    """
    from scenectl.running import connected, run

    async def work() -> Revoked:
        async with connected(output.profile) as cluster:
            if who.node is None:
                return await cluster.membership.revoke_user(who.user)
            return await cluster.membership.revoke_node(who.node)

    done = run(work)
    document = {"revoked": str(who), "changed": done.keys, "removed": done.line}
    emit(output, document, revoked_text(str(who), done, is_node=who.node is not None))


def revoked_text(who: str, done: Revoked, *, is_node: bool) -> str:
    """What a revocation did now, and what was done before."""
    keys = f"The keys of {who} count no longer." if done.keys else f"The keys of {who} counted no longer already."
    if not is_node:
        return keys
    return f"{keys} The node is taken off the line." if done.line else f"{keys} The node does not stand on the line."


def renew(*certificates: Path, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Issue new certificates for all keys in a profile that has the authority's key, or for a member that was away. No node need run.

    Needed only after the cluster, or one member, was off for so long that certificates ran out, or a clock was wrong: else they are renewed by themselves. The first node's profile has that key, too, sealed to the node. Copy each node's `nodes/ADDRESS/certificate.pem` to its machine afterwards.

    Example: scenectl cluster renew --profile studio

    Example: scenectl cluster renew ada.pem --profile studio

    Parameters
    ----------
    certificates
        Copies of members' `certificate.pem`, to be written over by new ones for the same keys; the keys themselves stay where they are. By default all that lie in the profile.
    """
    from scenefold.client import profile_folder
    from scenefold.world.profile import ClusterProfile
    from scenefold.world.reissue import reissue

    cards = reissue(ClusterProfile.load(profile_folder(output.profile)), certificates)
    documents = [{"name": card.name, "not_after": f"{card.not_after:%Y-%m-%d}"} for card in cards]
    rows = [(shown_member(one["name"]), one["not_after"]) for one in documents]
    emit(output, {"renewed": documents}, table(("member", "certificate until"), rows))


def _roll(output: ProfileOutput) -> Roll:
    from scenectl.running import connected, run

    async def work() -> Roll:
        async with connected(output.profile) as cluster:
            return await cluster.membership.roll()

    return run(work)


def _state(invitation: Invitation, now: float) -> str:
    from scenefold.world.roll import InvitationState

    if invitation.state is InvitationState.OPEN and invitation.entry.expires < now:
        return "expired"
    return invitation.state.name.lower()


def _id(key: bytes) -> str:
    return key.hex()[:ID_DIGITS]


def _time(moment: float) -> str:
    return f"{datetime.datetime.fromtimestamp(moment, datetime.UTC):%Y-%m-%d %H:%M} UTC"
