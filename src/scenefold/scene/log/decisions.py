"""Was this header decided, and is this its log? (specs/16-scene-log.md, Decisions.) Pure.

An owner signs a header when it is proposed; that it is the scene's next one, and no other, say those who decide: the origin, by a key that
the scene's genesis holds, or participants, whom the origin named first. So nobody believes what was only proposed, whoever shows it.
"""

from __future__ import annotations

from dataclasses import dataclass

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId
from scenefold.crypto import DECISION_DOMAIN, PublicKey, SigningKey
from scenefold.scene.log.book import SceneLog
from scenefold.scene.log.certified import BY_PARTICIPANTS, check_certified, decided_by_origin
from scenefold.scene.log.undecided import undecided
from scenefold.wire import Decision, SceneLogPublic, hash_of_record

BY_ORIGIN = 1
"""The form of a decision by one node: one certificate, its signature."""


@dataclass(frozen=True, slots=True)
class Decider:
    """The node that decides a scene's log, and the key that it signs with."""

    node: NodeId
    key: bytes


def decided(public: SceneLogPublic, key: SigningKey) -> SceneLogPublic:
    """The header as decided by the node with this key, as long as no participants do."""
    if public.participants:
        return decided_by_origin(public, key)
    signature = key.sign(DECISION_DOMAIN, public.signable())
    return public.decided_by(Decision(BY_ORIGIN, (signature,)))


def check_decided(public: SceneLogPublic) -> None:
    """Undecided unless those who decide the scene's log have signed this header. That it is the scene's, other checks tell."""
    decision = public.decision
    if decision is None:
        raise undecided(public, "the header was proposed, and nobody shows that it was decided")
    if decision.form not in (BY_ORIGIN, BY_PARTICIPANTS):
        what = f"the header is decided in form {decision.form}, which this program does not know"
        raise undecided(public, what, remedy="update this program")
    if (decision.form == BY_PARTICIPANTS) != bool(public.participants):
        raise undecided(public, "the header is decided in the form of one with others who decide")
    if decision.form == BY_PARTICIPANTS:
        check_certified(public, decision)
        return
    if len(decision.certificates) != 1:
        raise undecided(public, "the decision of the header is ill-formed")
    try:
        PublicKey(public.origin_key).verify(decision.certificates[0], DECISION_DOMAIN, public.signable())
    except DamagedData as problem:
        raise undecided(public, "the header is not decided by the node that decides the scene's log") from problem


def hash_of_log(private: bytes) -> bytes:
    """What a header says of its sealed log."""
    return hash_of_record(private)


def check_told(public: SceneLogPublic, log: SceneLog, *, is_shortened: bool = False) -> None:
    """DamagedData unless the header says of keys, and of those who take part, what its log says. Who decides cannot read the log.

    `is_shortened`: it begins with a snapshot. Then all else is compared as well: headers of early programs, which knew none, may differ.
    """
    where = f"scene {public.scene:08x}, log position {public.position}"
    if log.grants.key_epoch != public.key_epoch:
        raise DamagedData("the scene's log and its header name other key epochs", where=where)
    if (log.roster.participants, log.roster.observers) != (public.participants, public.observers):
        raise DamagedData("the scene's log and its header name others who take part", where=where)
    if is_shortened and (
        (log.mode, log.public_spaces(), log.grants.writers) != (public.mode, public.spaces, public.writers)
        or public.write_floor < log.write_floor
        or public.purged < log.purged
    ):
        raise DamagedData("the scene's log and its header tell otherwise of its mode, spaces or writers", where=where)


def check_log(public: SceneLogPublic, private: bytes) -> None:
    """DamagedData unless this is the sealed log that the header names."""
    if hash_of_log(private) != public.log_hash:
        where = f"scene {public.scene:08x}, log position {public.position}"
        raise DamagedData("the scene's log is not the one that its header names", where=where)
