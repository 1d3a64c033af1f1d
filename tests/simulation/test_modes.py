"""If this fails, nodes that decide a scene act in a mode too early, never, or without a lease (design scenarios 27, 28 and 40, on whole nodes)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import KeyId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import LEASE_DOMAIN, SigningKey
from scenefold.peer.modes import Borrower
from scenefold.peer.modes.packets import lease_message
from scenefold.peer.modes.scene_modes import SceneModes
from scenefold.peer.timing import T_LEASE_S, T_WAIT_S
from scenefold.wire import (
    AcceptSceneProposal,
    BorrowLease,
    Fault,
    LeaseUse,
    LentLease,
    RejectSceneProposal,
    RequestSceneLog,
    RespondSceneLog,
    SceneMode,
    SetMode,
    Want,
)
from simulation.assembly import Assembly, assembled
from unit.scene.log.members import secrets_of

CLIENT = Borrower(KeyId(1), bytes(16))
LEASE_S = 5.0
"""For a node to have a lease, where it may."""


def modes(them: Assembly, slot: int) -> SceneModes:
    one = them.of(slot).participation.of(them.scene)
    assert one is not None
    return one.modes


async def acting(them: Assembly, *slots: int, within_s: float = LEASE_S) -> list[SceneMode | None]:
    return [await modes(them, slot).acting(within_s) for slot in slots]


def test_all_who_can_hear_each_other_switch_at_once_and_back() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        assert await acting(them, 0, 1, 2) == [SceneMode.EDIT] * 3
        # For all that a node knows at its start somebody may have been removed a moment before.
        await trio.sleep(T_WAIT_S)
        for mode in (SceneMode.RENDER, SceneMode.EDIT):
            position = await them.commits(1, SetMode(mode))
            await them.everybody_at(position, 0, 1, 2)
            began = trio.current_time()
            await them.until(lambda: all(modes(them, slot).is_active for slot in range(3)), T_WAIT_S / 2)
            assert trio.current_time() - began < T_WAIT_S / 2
            assert await acting(them, 0, 1, 2) == [mode] * 3

    assembled(3, main)


def test_28_who_is_cut_off_is_waited_for() -> None:
    """And 40: the one that is alone has no lease after a while, and does not know the mode."""

    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        assert await acting(them, 0, 1, 2) == [SceneMode.EDIT] * 3
        alone = modes(them, 2)
        net = them.cluster.net
        ours, its = [them.node(slot).address for slot in (0, 1)], [them.node(2).address]
        parted = net.partition(ours, its)
        position = await them.commits(0, SetMode(SceneMode.RENDER))
        learnt = trio.current_time()
        await them.everybody_at(position, 0, 1)
        await trio.sleep(T_WAIT_S - 3.0)
        assert not modes(them, 0).is_active and not modes(them, 1).is_active
        await them.until(lambda: modes(them, 0).is_active and modes(them, 1).is_active, 10.0)
        assert trio.current_time() - learnt >= T_LEASE_S
        assert alone.standing.acts_in(them.of(2).world.clock.now()) is None
        assert await alone.acting(LEASE_S) is None
        assert await acting(them, 0, 1) == [SceneMode.RENDER] * 2
        net.unite(parted)
        await them.everybody_at(position, 2, within_s=120.0)
        await them.until(lambda: alone.is_active, T_WAIT_S + 5.0)
        assert await acting(them, 2) == [SceneMode.RENDER]

    assembled(3, main)


def test_what_is_lent_keeps_a_participant_from_voting_for_a_switch() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0)
        await trio.sleep(T_WAIT_S)
        assert await acting(them, 0) == [SceneMode.EDIT]
        one = modes(them, 0)
        one.standing, left = one.standing.lends(CLIENT, them.of(0).world.clock.now())
        assert left > 0
        refused = await them.change(0, SetMode(SceneMode.RENDER))
        assert isinstance(refused, RejectSceneProposal) and refused.reason is RejectReason.BUSY
        assert isinstance(await them.change(0), AcceptSceneProposal), "other entries go on"
        one.standing = one.standing.given_back(CLIENT)
        assert isinstance(await them.change(0, SetMode(SceneMode.RENDER)), AcceptSceneProposal)
        await them.until(lambda: one.is_active, 3.0)

    assembled(1, main)


def test_after_a_start_something_may_be_lent_and_a_mode_is_waited_for() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await them.commits(0, SetMode(SceneMode.RENDER))
        await them.until(lambda: modes(them, 0).is_active)
        them.crash(0)
        await them.start(0)
        await them.until(lambda: them.takes_part(0))
        now = them.of(0).world.clock.now
        assert modes(them, 0).standing.lender.is_live(now()) and not modes(them, 0).is_active
        await them.until(lambda: modes(them, 0).is_active and not modes(them, 0).standing.lender.is_live(now()), T_WAIT_S + 2.0)

    assembled(3, main)


async def borrow(
    them: Assembly, slot: int, use: LeaseUse, nonce: int, key: SigningKey | None = None, **more: Any
) -> LentLease | RejectReason:
    """What a client of the maker's is answered there."""
    key = key or secrets_of(200).signing
    plain = BorrowLease(them.scene, them.genesis, use, nonce, key=key.key_id, process=b"p" * 16, **more)
    packet = replace(plain, signature=key.sign(LEASE_DOMAIN, plain.signable()))
    try:
        reply = await them.ask(slot, packet)
    except Refused as refusal:
        return refusal.reason
    assert isinstance(reply, LentLease | Fault), reply
    return reply if isinstance(reply, LentLease) else RejectReason(reply.reason)


def test_a_client_borrows_of_a_participant_and_gives_back() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1)
        await trio.sleep(T_WAIT_S)
        lender, me = 1, {"lender": them.of(1).me}
        for slot, named in ((2, me), (0, me), (1, {}), (2, {})):
            assert await borrow(them, slot, LeaseUse.EDIT, 1, **named) is RejectReason.NOT_AUTHORISED, "of whom he means, and nobody else"
        lent = await borrow(them, lender, LeaseUse.EDIT, 1, **me)
        assert (
            isinstance(lent, LentLease) and 0 < lent.left_ms <= T_LEASE_S * 1000 and (lent.mode, lent.is_active) == (SceneMode.EDIT, True)
        )
        assert await borrow(them, lender, LeaseUse.EDIT, 1, **me) is RejectReason.STALE_VERSION
        assert await borrow(them, lender, LeaseUse.RENDER, 2, **me) is RejectReason.MODE_FORBIDS
        assert await borrow(them, lender, LeaseUse.EDIT, 2, key=secrets_of(7).signing, **me) is RejectReason.NOT_AUTHORISED
        assert await borrow(them, lender, LeaseUse.GIVE_BACK, 2) is RejectReason.NOT_AUTHORISED
        refused = await them.change(1 - lender, SetMode(SceneMode.RENDER))
        assert not isinstance(refused, AcceptSceneProposal), "the lender does not vote, and two of two are needed"
        await trio.sleep(1.0)
        renewed = await borrow(them, lender, LeaseUse.EDIT, 3, **me)
        assert isinstance(renewed, LentLease) and renewed.is_asked_back and renewed.left_ms < lent.left_ms, "and no more than what was left"
        other = {"lender": them.of(1 - lender).me}
        assert await borrow(them, 1 - lender, LeaseUse.EDIT, 1, **other) is RejectReason.BUSY, "the others lend nothing meanwhile"
        back = await borrow(them, lender, LeaseUse.GIVE_BACK, 4, **me)
        assert isinstance(back, LentLease) and back.left_ms == 0
        assert await them.commits(1 - lender, SetMode(SceneMode.RENDER)) == 2
        await them.until(lambda: all(modes(them, slot).is_active for slot in (0, 1)), 5.0)
        assert await borrow(them, lender, LeaseUse.EDIT, 5, **me) is RejectReason.MODE_FORBIDS
        looked = await borrow(them, 2, LeaseUse.LOOK, 0)
        assert isinstance(looked, LentLease) and (looked.position, looked.mode, looked.is_active) == (2, SceneMode.RENDER, True)
        assert isinstance(await borrow(them, lender, LeaseUse.RENDER, 6, **me), LentLease)

    assembled(3, main)


def test_27_who_has_writes_under_way_is_named_and_the_log_stays_as_it_is() -> None:
    """What a client borrowed to write it has not given back in the time that is given to it."""

    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await trio.sleep(T_WAIT_S)
        lender, me = 2, {"lender": them.of(2).me}
        assert isinstance(await borrow(them, lender, LeaseUse.EDIT, 1, **me), LentLease)
        before = them.of(0).scenes.here(them.scene)
        for asked in (0, 1):
            refused = await them.change(asked, SetMode(SceneMode.RENDER))
            assert isinstance(refused, RejectSceneProposal)
            assert (refused.reason, refused.node) == (RejectReason.BUSY, them.of(lender).me), (
                "of a majority that could decide it all the same"
            )
        assert [them.position(slot) for slot in range(3)] == [1] * 3 and them.of(0).scenes.here(them.scene) == before
        assert isinstance(await borrow(them, lender, LeaseUse.GIVE_BACK, 2, **me), LentLease)
        assert await them.commits(0, SetMode(SceneMode.RENDER)) == 2

    assembled(3, main)


def test_40_who_is_alone_says_that_the_mode_is_unknown() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        them.crash(0, 1)
        await trio.sleep(T_LEASE_S)
        for nonce, use in enumerate((LeaseUse.LOOK, LeaseUse.EDIT, LeaseUse.RENDER), 1):
            assert await borrow(them, 2, use, nonce, lender=them.of(2).me) is RejectReason.MODE_FORBIDS

    assembled(3, main)


def test_a_lease_is_granted_to_who_takes_part_and_signs() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1)
        own, stranger = them.of(1).own, them.of(2).own
        have = them.position(0)
        cases = [
            (own.member, own.me, b"\1" * 64, RejectReason.SIGNATURE_INVALID),
            (own.member, stranger.me, b"\1" * 64, RejectReason.NOT_AUTHORISED),
            (stranger.member, stranger.me, b"\1" * 64, RejectReason.NOT_AUTHORISED),
        ]
        for member, asker, proof, reason in cases:
            packet = RequestSceneLog(them.scene, them.genesis, have, 1, Want.LEASE, member, proof)
            try:
                await modes(them, 0).on_lease(packet, asker)
            except Refused as refusal:
                found: RejectReason | None = refusal.reason
            else:
                found = None
            assert found is reason

    assembled(3, main)


def test_only_one_who_signs_makes_a_node_ask_for_what_it_lacks() -> None:
    """A stranger, and who names another incarnation, may say that it has more than there is: it is granted nothing, and nobody is asked."""

    async def main(them: Assembly) -> None:
        await them.create(0, 1)
        one, asked = modes(them, 0), list[int]()
        one._behind = lambda: asked.append(1)
        own, stranger = them.of(1).own, them.of(2).own
        reborn = replace(own.member, incarnation=bytes(16))
        for member in (stranger.member, reborn):
            answer = await one.on_lease(RequestSceneLog(them.scene, them.genesis, 2**60, 1, Want.LEASE, member, bytes(64)), member.node)
            assert isinstance(answer, RespondSceneLog) and answer.answer is not None and answer.answer.flags == 0
        assert not asked
        asking = RequestSceneLog(them.scene, them.genesis, 2**60, 1, Want.LEASE, own.member)
        signed = replace(asking, proof=own.key.sign(LEASE_DOMAIN, lease_message(asking, own.member)))
        await one.on_lease(signed, own.me)
        assert asked == [1]

    assembled(3, main)
