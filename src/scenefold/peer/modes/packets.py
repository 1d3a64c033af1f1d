"""What packets of a scene's log say that matters to leases, and what nodes sign for them. Pure."""

from __future__ import annotations

from collections.abc import Iterable

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.reasons import RejectReason
from scenefold.consensus.facts import Fact
from scenefold.crypto import LEASE_DOMAIN, PublicKey
from scenefold.wire import AcceptValue, DecidedLog, Member, Packet, ProposeValue, RejectValue, Release, RequestSceneLog, RespondSceneLog


def said_in(packet: Packet, position: int) -> tuple[int, tuple[Fact, ...], tuple[Release, ...]]:
    """The facts about this position that a packet brings, and the releases, whatever they are of: of each member the highest.

    They are few, however much a packet holds: each costs the check of a signature.
    """
    match packet:
        case (
            ProposeValue(proposal=proposal, facts=facts)
            | AcceptValue(proposal=proposal, facts=facts)
            | RejectValue(proposal=proposal, facts=facts)
        ):
            return proposal.position, facts, ()
        case RespondSceneLog(decided=DecidedLog(decided=decided)):
            votes = next((value.votes for value in decided if value.position == position), ())
            return position, votes, _highest(release for value in decided for release in value.releases)
        case _:
            return 0, (), ()


def _highest(releases: Iterable[Release]) -> tuple[Release, ...]:
    found: dict[Member, Release] = {}
    for release in releases:
        known = found.setdefault(release.member, release)
        if release.position > known.position:
            found[release.member] = release
    return tuple(found.values())


def lease_message(packet: RequestSceneLog, member: Member) -> bytes:
    """What the asker of a scene's lease signs, under the domain of leases."""
    numbers = packet.have.to_bytes(8, "big") + packet.nonce.to_bytes(8, "big")
    return packet.genesis + numbers + member.node.to_bytes(4, "big") + member.incarnation


def check_proof(key: PublicKey, packet: RequestSceneLog, member: Member) -> None:
    try:
        key.verify(packet.proof, LEASE_DOMAIN, lease_message(packet, member))
    except DamagedData as problem:
        raise Refused(RejectReason.SIGNATURE_INVALID, "the asker has not signed what it asks for") from problem
