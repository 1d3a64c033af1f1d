"""Writes specs/vectors/consensus.json: what any implementation of specs/25-consensus.md and of decisions in form 2 must give.

    .venv/bin/python tools/make_consensus_vectors.py

Facts with what their signatures sign; a scene's header, the value that brings it, and the certificates by which others see that it was
decided. The inputs are fixed and signatures deterministic, so the file changes only when the format does.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from scenefold.base.ids import KeyId, NodeId, SceneId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import SigningKey
from scenefold.scene.log import decided, decided_by_votes, signed_header, value_of
from scenefold.wire import (
    Ballot,
    KeyEntry,
    Member,
    ParticipantEntry,
    Phase,
    Promise,
    ProposalId,
    Refusal,
    Release,
    SceneLogPublic,
    SceneMode,
    Vote,
    digest_of_header,
    digest_of_participants,
)

TARGET = Path(__file__).parents[1] / "specs" / "vectors" / "consensus.json"
GENESIS = bytes(range(32))
DIGEST = bytes(range(32, 64))
HEADER_KEY = SigningKey.from_seed(bytes(range(64, 96)))
ORIGIN_KEY = SigningKey.from_seed(bytes(range(96, 128)))
ORIGIN = NodeId(0x7F000002)
BALLOT = Ballot(3, NodeId(0x7F000003))
SEALED = b"a sealed log"
NODES = (0x7F000003, 0x7F000004, 0x7F000005)
FOURTH = 0x7F000006


def key_of(node: int) -> SigningKey:
    return SigningKey.from_seed(node.to_bytes(32, "little"))


def participant(node: int) -> ParticipantEntry:
    return ParticipantEntry(Member(NodeId(node), node.to_bytes(16, "little")), key_of(node).public.raw)


def document() -> dict[str, Any]:
    """The file's content."""
    return {"genesis": GENESIS.hex(), "facts": [_fact(fact) for fact in facts()], "scene": scene()}


def facts() -> list[Promise | Vote | Refusal | Release]:
    """One of each kind, unsigned; a promise with and one without something that was voted for."""
    who = participant(NODES[0]).member
    proposal = ProposalId(7, BALLOT, Phase.ACCEPT)
    return [
        Promise(7, BALLOT, Ballot(2, NodeId(NODES[1])), DIGEST, who),
        Promise(7, BALLOT, Ballot(0, NodeId(0)), bytes(32), who),
        Vote(7, BALLOT, DIGEST, who),
        Refusal(proposal, RejectReason.POSITION_TAKEN, Ballot(9, NodeId(NODES[2])), who),
        Release(7, who),
    ]


def _fact(fact: Promise | Vote | Refusal | Release) -> dict[str, Any]:
    signable = fact.signable(GENESIS)
    return {
        "kind": type(fact).__name__,
        "seed": key_of(fact.member.node).seed.hex(),
        "domain": fact.DOMAIN.decode(),
        "signable": signable.hex(),
        "signature": key_of(fact.member.node).sign(fact.DOMAIN, signable).hex(),
    }


def scene() -> dict[str, Any]:
    """Position 1 is decided by the origin, and names three; at position 2 a fourth joins, by two of the three; at 3 nothing else changes."""
    first, second, third = headers()
    value = value_of(third, SEALED, second)
    assert third.decision is not None
    return {
        "origin_key": ORIGIN_KEY.public.raw.hex(),
        "participants": [[one.member.node, one.member.incarnation.hex(), one.key.hex()] for one in third.participants],
        "headers": [one.encode().hex() for one in (first, second, third)],
        "header_digest": digest_of_header(third).hex(),
        "participants_digest": digest_of_participants(third.participants).hex(),
        "value": {"data": value.data.hex(), "body": value.body.hex(), "digest": value.digest.hex(), "kept": value.encode().hex()},
        "certificates": [one.hex() for one in third.decision.certificates],
    }


def headers() -> tuple[SceneLogPublic, SceneLogPublic, SceneLogPublic]:
    """Decided ones, of positions 1 to 3."""
    three = tuple(map(participant, NODES))
    born = SceneLogPublic(
        scene=SceneId(1),
        genesis=bytes(32),
        origin=ORIGIN,
        position=1,
        write_floor=0,
        mode=SceneMode.EDIT,
        spaces=(),
        writers=(),
        public_key=HEADER_KEY.key_id,
        private_key=KeyId(0),
        keys=(KeyEntry(1, HEADER_KEY.public.raw),),
        first_key=HEADER_KEY.public.raw,
        origin_key=ORIGIN_KEY.public.raw,
        participants=three,
    ).with_genesis()
    first = decided(signed_header(born, SEALED, HEADER_KEY), ORIGIN_KEY)
    second = _voted(first, participants=(*three, participant(FOURTH)))
    return first, second, _voted(second)


def _voted(known: SceneLogPublic, **changes: Any) -> SceneLogPublic:
    position = known.position + 1
    request = position.to_bytes(16, "big")
    header = replace(known, position=position, request=request, previous=digest_of_header(known), decision=None, **changes)
    header = signed_header(header, SEALED, HEADER_KEY)
    digest = value_of(header, SEALED, known).digest
    votes = [Vote(position, BALLOT, digest, one.member) for one in known.participants]
    voted = [replace(one, signature=key_of(one.member.node).sign(one.DOMAIN, one.signable(header.genesis))) for one in votes]
    return decided_by_votes(header, known, BALLOT, voted)


def main() -> None:
    TARGET.write_text(json.dumps(document(), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
