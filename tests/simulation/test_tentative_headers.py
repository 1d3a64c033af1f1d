"""If this fails, a node that keeps no log of a scene is frozen by a switch that nobody has decided (design scenario 21)."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.scene.log import BY_PARTICIPANTS, decided, value_of
from scenefold.wire import (
    AcceptSceneProposal,
    Ballot,
    Decision,
    NodeSignature,
    RespondSceneLog,
    SceneCertificate,
    SceneLogAnswer,
    SceneLogPublic,
    SceneMode,
    SetMode,
    Vote,
    digest_of_header,
)
from simulation.assembly import Assembly, assembled

RELAY = 3
"""A node that takes no part, and shows what it should not."""
STORES = 4
"""One that takes no part, and has no key."""


def test_21_a_tentative_header_that_a_relay_shows_moves_no_floor() -> None:
    """Whatever goes with it: nothing, the decision of before, and votes, true ones, that are no majority."""

    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        read = await them.read(0)
        known = read.public
        await them.everybody_at(known.position, 0, 1, 2, STORES)
        offered = them.following(read, SetMode(SceneMode.RENDER))
        tentative, digest = offered.header, value_of(offered.header, offered.private, known).digest
        assert (tentative.mode, tentative.write_floor) == (SceneMode.RENDER, tentative.position)
        ballot = Ballot(1, them.of(0).me)

        def voted(*slots: int) -> SceneLogPublic:
            votes = []
            for slot in slots:
                own = them.of(slot).own
                vote = Vote(tentative.position, ballot, digest, own.member)
                votes.append(NodeSignature(own.me, own.key.sign(Vote.DOMAIN, vote.signable(them.genesis))))
            assert known.decision is not None
            last = SceneCertificate(tentative.position, ballot, digest_of_header(tentative), (), tuple(votes))
            return tentative.decided_by(Decision(BY_PARTICIPANTS, (*known.decision.certificates, last.encode())))

        shown = {
            "nothing": tentative,
            "the decision of before": replace(tentative, decision=known.decision),
            "one vote": voted(0),
            "one vote twice": voted(0, 0),
            "one vote, and that of the relay": voted(0, RELAY),
            "the word of the origin alone": decided(tentative, them.of(0).own.key),
        }
        for name, header in shown.items():
            push = RespondSceneLog(answer=SceneLogAnswer(0, 0, header.position, header, None))
            await them.ask(STORES, push, f"node:{them.of(RELAY).me}")
            kept = them.of(STORES).scenes.here(them.scene)
            assert kept is not None and kept.public == known, name
            with pytest.raises(Refused) as told:
                await them.of(STORES).scenes.adopt(header)
            assert told.value.reason in (RejectReason.SIGNATURE_INVALID, RejectReason.NOT_AUTHORISED), name
        assert isinstance(await them.offer(0, offered), AcceptSceneProposal)
        await them.everybody_at(tentative.position, STORES)
        kept = them.of(STORES).scenes.here(them.scene)
        assert kept is not None and (kept.public.mode, kept.public.write_floor) == (SceneMode.RENDER, tentative.position)

    assembled(STORES + 1, main)
