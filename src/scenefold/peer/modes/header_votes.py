"""What the votes in a scene's public header say was decided, for who keeps no log of it (specs/16-scene-log.md, Decisions). Pure."""

from __future__ import annotations

from scenefold.consensus import Certificate, Decide, Value, Vote
from scenefold.scene.log.certified import BY_PARTICIPANTS
from scenefold.scene.log.values import data_of, deciders_after
from scenefold.wire import SceneCertificate, SceneLogPublic, digest_of_header


def shown_by_header(public: SceneLogPublic, before: SceneLogPublic) -> Decide | None:
    """The decision of a header that was verified, with the data of its value alone; None if the scene's origin decided it alone.

    `before`: the header of the position before, or of an earlier one; if others decided since, the value is said to be another one, and no
    vote is a vote for it.
    """
    decision = public.decision
    if decision is None or decision.form != BY_PARTICIPANTS:
        return None
    found = SceneCertificate.decode(decision.certificates[-1])
    deciders = deciders_after(before)
    value = Value(data_of(deciders, deciders_after(public), digest_of_header(public)))
    members = {entry.member.node: entry.member for entry in deciders}
    votes = tuple(
        Vote(found.position, found.ballot, value.digest, members[vote.node], vote.signature) for vote in found.votes if vote.node in members
    )
    return Decide(found.position, value, Certificate(found.position, found.ballot, votes))
