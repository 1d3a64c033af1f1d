"""Decisions by participants: a chain of certificates from the origin's key to the newest header (specs/16-scene-log.md, Decisions, form 2). Pure.

Each certificate but the last shows who decides from its position on; the last one is the header's own. Who decided stands in what was
voted for, so that no link can be left out: the votes of a few are a majority of nobody else.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import NodeId
from scenefold.base.limits import CERTIFICATES_MAX
from scenefold.crypto import PublicKey, SigningKey
from scenefold.scene.log.roster import Entries, misfit
from scenefold.scene.log.undecided import undecided
from scenefold.scene.log.values import data_of, deciders_after, origin_alone
from scenefold.wire import (
    Ballot,
    Decision,
    MalformedPacket,
    NodeSignature,
    SceneCertificate,
    SceneLogPublic,
    Vote,
    digest_of_header,
    hash_of_record,
)

BY_PARTICIPANTS = 2
"""The form of a decision by votes."""
CHANGES_MAX = CERTIFICATES_MAX - 1
"""How often participants may change in a scene's life: each change is a certificate, and the newest header has its own."""
NO_BALLOT = Ballot(0, NodeId(0))
"""In which a scene's origin decides, as long as nobody else does."""
_REMEMBERED_MAX = 1_024
"""Certificates that were verified: the next header of a scene brings all but one again."""


def decided_by_origin(public: SceneLogPublic, key: SigningKey) -> SceneLogPublic:
    """The header by which a scene has participants, as decided by its origin alone: the first certificate."""
    origin, header = origin_alone(public), digest_of_header(public)
    digest = hash_of_record(data_of((origin,), public.participants, header))
    vote = Vote(public.position, NO_BALLOT, digest, origin.member)
    signature = NodeSignature(origin.member.node, key.sign(Vote.DOMAIN, vote.signable(public.genesis)))
    first = SceneCertificate(public.position, NO_BALLOT, header, public.participants, (signature,))
    return public.decided_by(Decision(BY_PARTICIPANTS, (first.encode(),)))


def decided_by_votes(public: SceneLogPublic, known: SceneLogPublic, ballot: Ballot, votes: Iterable[Vote]) -> SceneLogPublic:
    """The header as decided by these votes in one ballot, which are true ones; `known` is the decided header before.

    LocalFault if they are too few.
    """
    deciders, header = deciders_after(known), digest_of_header(public)
    digest = hash_of_record(data_of(deciders, deciders_after(public), header))
    signatures = {
        vote.member: vote.signature for vote in votes if (vote.position, vote.ballot, vote.digest) == (public.position, ballot, digest)
    }
    signed = [NodeSignature(entry.member.node, signatures[entry.member]) for entry in deciders if entry.member in signatures]
    if len(signed) < _majority(deciders):
        raise LocalFault("these votes are no majority", where=f"scene {public.scene:08x}, log position {public.position}")
    named = () if public.participants == known.participants else public.participants
    own = SceneCertificate(public.position, ballot, header, named, tuple(signed[: _majority(deciders)]))
    return public.decided_by(Decision(BY_PARTICIPANTS, (*_changes(known), own.encode())))


def changes_before(public: SceneLogPublic) -> int:
    """How often those who decide have changed, up to this decided header."""
    return len(_changes(public))


def changes_left(public: SceneLogPublic) -> int:
    """How often those who decide can still change, behind this decided header."""
    return max(0, CHANGES_MAX - changes_before(public))


def began_with(public: SceneLogPublic) -> bytes:
    """The certificate by which the origin had others decide, once for all; empty if it decides alone."""
    decision = public.decision
    return decision.certificates[0] if decision is not None and decision.form == BY_PARTICIPANTS and decision.certificates else b""


def check_certified(public: SceneLogPublic, decision: Decision) -> None:
    """Undecided unless the certificates lead from the scene's origin to this header."""
    if not decision.certificates:
        raise undecided(public, "the decision of the header is ill-formed")
    try:
        position, header, after = _led_to(public, decision.certificates)
    except (MalformedPacket, DamagedData) as problem:
        raise undecided(public, "the header's certificates do not show that it was decided") from problem
    if (position, header, after) != (public.position, digest_of_header(public), public.participants):
        raise undecided(public, "the header's certificates are those of another header")


def _led_to(public: SceneLogPublic, certificates: tuple[bytes, ...]) -> tuple[int, bytes, Entries]:
    """Position, digest and participants of the header that the last certificate is of."""
    deciders: Entries = (origin_alone(public),)
    position, header = 0, b""
    for index, data in enumerate(certificates):
        is_last = index == len(certificates) - 1
        before = position
        position, header, after = _proven(public.genesis, deciders, data, by_origin=index == 0)
        if position <= before or (after == deciders and not is_last):
            raise DamagedData("the certificates are out of order")
        deciders = after
    return position, header, deciders


@lru_cache(_REMEMBERED_MAX)
def _proven(genesis: bytes, deciders: Entries, data: bytes, *, by_origin: bool) -> tuple[int, bytes, Entries]:
    """What a certificate shows, by those who decide its position; DamagedData or MalformedPacket if it shows nothing."""
    found = SceneCertificate.decode(data)
    after = found.participants or deciders
    if by_origin:
        problem = misfit((), (), found.participants, ()) if found.participants and found.ballot == NO_BALLOT else "the origin decides once"
    elif found.participants:
        problem = "who decides stays" if after == deciders else misfit(deciders, (), after, ())
    else:
        problem = ""
    if problem:
        raise DamagedData(problem)
    digest = hash_of_record(data_of(deciders, after, found.header))
    keys = {entry.member.node: entry for entry in deciders}
    voters = [vote.node for vote in found.votes]
    if voters != sorted(set(voters)) or not keys.keys() >= set(voters) or len(voters) != _majority(deciders):
        raise DamagedData("the votes are not those of a majority")
    for vote in found.votes:
        entry = keys[vote.node]
        signable = Vote(found.position, found.ballot, digest, entry.member).signable(genesis)
        PublicKey(entry.key).verify(vote.signature, Vote.DOMAIN, signable)
    return found.position, found.header, after


def _changes(public: SceneLogPublic) -> tuple[bytes, ...]:
    """The certificates of a decided header that show who decides: all that those who come after it need."""
    decision = public.decision
    if decision is None or decision.form != BY_PARTICIPANTS:
        return ()
    *before, last = decision.certificates
    return (*before, last) if SceneCertificate.decode(last).participants else tuple(before)


def _majority(deciders: Entries) -> int:
    return len(deciders) // 2 + 1
