"""If this fails, a network that is cut in two leaves two histories of a scene's log behind, or its smaller part decides, or hides what it knows."""

from __future__ import annotations

import pytest

from scenefold.base.reasons import RejectReason
from scenefold.client.offers import refusal_of
from scenefold.scene.log import Followed
from scenefold.wire import AcceptSceneProposal, ProposeSceneLog, RejectSceneProposal, SceneLogPublic, SceneMode, SetMode
from scenefold.world.sim import Point
from simulation.assembly import Assembly, assembled

NODES = 5
UNCLEAR = (RejectReason.NO_MAJORITY, RejectReason.NOT_READY)
"""No majority, or nobody knows yet: whoever was alive for the others a moment ago has exposed what was asked for."""


async def one_history(them: Assembly) -> dict[bytes, int]:
    """All nodes come to the same log, by themselves; gives its requests."""
    await them.everybody_at(max(them.position(slot) for slot in range(NODES)), *range(NODES))
    reads = [await them.read(slot) for slot in range(NODES)]
    assert len({(read.public.signable(), read.private) for read in reads}) == 1
    return dict(reads[0].log.state.requests)


async def offered_to(them: Assembly, slots: range, offered: Followed) -> set[RejectReason]:
    """Why none of these has it decided."""
    replies = [await them.offer(slot, offered) for slot in slots]
    assert all(isinstance(reply, RejectSceneProposal) for reply in replies), replies
    return {reply.reason for reply in replies if isinstance(reply, RejectSceneProposal)}


async def looked(them: Assembly, slot: int, public: SceneLogPublic) -> object:
    """A barrier."""
    return await them.ask(slot, ProposeSceneLog(them.genesis, public.proposed(), b""))


@pytest.mark.parametrize("few", [range(2), range(1, 3), range(4, 5)], ids=["with the origin", "in the middle", "one alone"])
def test_the_few_refuse_and_show_and_the_many_go_on(few: range) -> None:
    async def main(them: Assembly) -> None:
        many = [slot for slot in range(NODES) if slot not in few]
        await them.create(*range(NODES))
        await them.commits(many[0])
        await them.everybody_at(2, *range(NODES))
        first = await them.read(few[0])
        sides = [[them.node(slot).address for slot in side] for side in (few, many)]
        crack = them.cluster.net.partition(*sides)

        refused = them.following(first, them.grant())
        reasons = await offered_to(them, few, refused)
        assert reasons <= {*UNCLEAR}, reasons
        # Once the others are known to be away it is plain, and whoever asks is told how many must agree.
        await them.until(lambda: all(not them.of(slot).roster.is_believed_alive(them.node(many[0]).node_id) for slot in few))
        plain, mode = them.following(first, them.grant()), them.following(first, SetMode(SceneMode.RENDER))
        for refusable in (plain, mode):
            assert RejectReason.NO_MAJORITY in await offered_to(them, few, refusable)
        words = str(refusal_of(RejectReason.NO_MAJORITY, them.node(few[0]).node_id, name="kitchen", before=first.public))
        assert "3 of 5 must agree" in words and "nothing was changed" in words
        for slot in few:
            assert (await them.read(slot)).public.proposed() == first.public.proposed(), "what was decided is shown"
            answer = await looked(them, slot, first.public)
            assert isinstance(answer, RejectSceneProposal) and answer.reason is RejectReason.NO_MAJORITY, (
                "nobody is told that nothing was begun"
            )

        positions = [await them.commits(slot) for slot in many]
        assert positions == list(range(3, 3 + len(many)))
        assert {them.position(slot) for slot in few} == {2}

        them.cluster.net.unite(crack)
        requests = await one_history(them)
        assert max(requests.values()) == positions[-1]
        assert not {one.header.request for one in (refused, plain, mode)} & requests.keys()
        for slot in few:
            late = await them.offer(slot, refused)
            assert isinstance(late, RejectSceneProposal) and late.reason is RejectReason.POSITION_BEHIND
        assert await them.commits(few[0]) == positions[-1] + 1
        await one_history(them)

    assembled(NODES, main)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_what_the_few_began_when_they_were_cut_off_is_in_the_log_once_at_most(count: int) -> None:
    """Behind the promise, the vote, or the decision of a node among them, while somebody else asks for the same position at the other side."""

    async def main(them: Assembly) -> None:
        await them.create(*range(NODES))
        read = await them.read(0)
        ours, theirs = them.following(read, them.grant()), them.following(read, them.grant())
        addresses = [them.node(slot).address for slot in range(NODES)]
        cracks = []
        them.cluster.net.trap(
            addresses[0], Point.AFTER_COMMIT, count, lambda: cracks.append(them.cluster.net.partition(addresses[:2], addresses[2:]))
        )
        them.nursery.start_soon(them.offer_in_vain, 0, ours)
        await them.until(lambda: bool(cracks))
        them.nursery.start_soon(them.offer_in_vain, 4, theirs)
        position = await them.commits(3)
        few_at = [them.position(slot) for slot in range(2)]
        assert max(few_at) <= (2 if count == 3 else 1), "two of five decide nothing"
        them.cluster.net.unite(cracks[0])
        requests = await one_history(them)
        assert max(requests.values()) >= position
        if count == 3:
            assert requests[ours.header.request] == 2, "it was decided"
        again = await them.offer(1, ours)
        if isinstance(again, AcceptSceneProposal):
            assert requests[ours.header.request] == again.position
        else:
            assert again.reason in (RejectReason.POSITION_TAKEN, RejectReason.POSITION_BEHIND)
        assert await them.commits(0) == max(requests.values()) + 1
        await one_history(them)

    assembled(NODES, main)
