"""A question for an owner lease as it travels where several voters grant it: packet 5 with LEASE (specs/26-modes.md, Owner leases). Pure.

    proof  =  signature of  genesis 32 | have u64 | nonce u64 | node u32 | incarnation 16 | number u64 | mark u64

Behind the first record that names a voter, `lives` are the two parts of one life; before it, two lives (log_rules.py).
"""

from __future__ import annotations

import struct

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import LEASE_DOMAIN, SigningKey
from scenefold.peer.cluster_log.lease_grants import Question
from scenefold.peer.cluster_log.numbered_lives import Life
from scenefold.peer.cluster_log.registry import Registry
from scenefold.wire import RequestSceneLog, Want

_PLACE = struct.Struct(">QQI")
_PARTS = 2


def signable(question: Question, genesis: bytes) -> bytes:
    """What the asker signs."""
    place = _PLACE.pack(question.have, question.nonce, question.member.node)
    return b"".join((genesis, place, question.member.incarnation, question.life.pack()))


def packet_of(question: Question, scene: SceneId, genesis: bytes, key: SigningKey) -> RequestSceneLog:
    """The question, signed by the node that asks it."""
    proof = key.sign(LEASE_DOMAIN, signable(question, genesis))
    return RequestSceneLog(scene, genesis, question.have, question.nonce, Want.LEASE, question.member, proof, tuple(question.life))


def question_in(packet: RequestSceneLog, asker: NodeId, registry: Registry) -> Question | None:
    """What a node asks; None if it does not know yet that voters grant leases.

    Refused: 12 it asks for another one, 5 under no life, 4 the proof is wrong. Whose incarnation is no member is refused by the voter's rules,
    whatever it has signed.
    """
    member = packet.member
    if member is None or member.node != asker:
        raise Refused(RejectReason.NOT_AUTHORISED, "a lease is asked for by the node itself")
    if packet.have < registry.voting.certified_from:
        return None
    if len(packet.lives) != _PARTS:
        raise Refused(RejectReason.ILL_FORMED, "a lease is asked for under a life")
    question = Question(member, packet.have, Life(*packet.lives), packet.nonce)
    known = registry.current(member.node)
    if known is not None and known.member == member:
        try:
            known.key.verify(packet.proof, LEASE_DOMAIN, signable(question, packet.genesis))
        except DamagedData as problem:
            raise Refused(RejectReason.SIGNATURE_INVALID, str(problem)) from problem
    return question
