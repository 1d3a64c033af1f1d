"""If this fails, a node that observes a scene has its render cut, holds up a switch for ever, or decides something (specs/26-modes.md, Observers)."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.peer.modes.own_use import OwnUse
from scenefold.peer.modes.scene_modes import SceneModes
from scenefold.peer.timing import T_WAIT_S
from scenefold.wire import (
    AcceptSceneProposal,
    AddObserver,
    Packet,
    RejectSceneProposal,
    RemoveObserver,
    RequestSceneLog,
    SceneMode,
    SetMode,
    Want,
)
from simulation.assembly import Assembly, assembled
from simulation.test_modes import modes

OBSERVER = 3
RENDER, EDIT = SetMode(SceneMode.RENDER), SetMode(SceneMode.EDIT)


def use(them: Assembly, slot: int = OBSERVER) -> OwnUse:
    found = them.of(slot).participation.own_use(them.scene)
    assert found is not None
    return found


def observing(them: Assembly, slot: int = OBSERVER) -> SceneModes:
    found = them.of(slot).participation.observations.of(them.scene)
    assert found is not None
    return found.modes


async def observed(them: Assembly, *slots: int) -> None:
    """0, 1 and 2 decide a scene; these observe it."""
    await them.create(0, 1, 2)
    for slot in slots or (OBSERVER,):
        entry = them.entry(slot)
        position = await them.commits(0, AddObserver(entry.member, entry.key))
        await them.until(lambda slot=slot: them.of(slot).participation.own_use(them.scene) is not None)
        await them.everybody_at(position, 0, 1, 2, slot)
    # For all that participants know of their start somebody may have been removed a moment before.
    await trio.sleep(T_WAIT_S)


async def switched(them: Assembly, to: SetMode, *slots: int, within_s: float) -> float:
    """How long it takes from the decision until it is active at all of these."""
    position = await them.commits(0, to)
    began = trio.current_time()
    await them.until(lambda: all(modes(them, slot).is_active for slot in range(3)), within_s)
    took = trio.current_time() - began
    await them.everybody_at(position, *slots)
    return took


@asynccontextmanager
async def rendering(them: Assembly, slot: int = OBSERVER) -> AsyncIterator[trio.Event]:
    """A render at an observer, until its event is set, or the end of this."""
    begun, end = trio.Event(), trio.Event()

    async def render() -> None:
        async with use(them, slot).hold(SceneMode.RENDER):
            begun.set()
            await end.wait()

    async with trio.open_nursery() as nursery:
        nursery.start_soon(render)
        await begun.wait()
        yield end
        end.set()


async def refusal(them: Assembly, slot: int, to: SetMode) -> RejectSceneProposal:
    reply = await them.change(slot, to)
    assert isinstance(reply, RejectSceneProposal), reply
    return reply


def test_who_observes_holds_a_lease_and_a_switch_waits_for_its_render() -> None:
    async def main(them: Assembly) -> None:
        await observed(them)
        assert await switched(them, RENDER, OBSERVER, within_s=T_WAIT_S / 2) < T_WAIT_S / 2, (
            "it says at once that it uses nothing of before"
        )
        async with rendering(them) as end:
            for slot in (0, 1):
                no = await refusal(them, slot, EDIT)
                assert (no.reason, no.node) == (RejectReason.BUSY, them.of(OBSERVER).me), "the observer, by its name"
            assert isinstance(await them.change(0), AcceptSceneProposal), "other entries go on"
            await trio.sleep(3 * T_WAIT_S)
            assert observing(them).acts_in is SceneMode.RENDER, "its lease is renewed"
            end.set()
        assert await switched(them, EDIT, OBSERVER, within_s=T_WAIT_S / 2) < T_WAIT_S / 2
        assert observing(them).public.mode is SceneMode.EDIT

    assembled(4, main)


def test_who_is_some_positions_behind_gets_a_lease_and_is_told_what_it_lacks() -> None:
    async def main(them: Assembly) -> None:
        await observed(them)
        await switched(them, RENDER, OBSERVER, within_s=T_WAIT_S)
        observations, missed = them.of(OBSERVER).participation.observations, list[int]()
        observations._is_behind = lambda _, position: missed.append(position)  # type: ignore[method-assign]
        # What is pushed to it meanwhile is lost on the way.
        observing(them).learnt = lambda _public: None  # type: ignore[method-assign]
        for _ in range(3):
            await them.commits(0)
        async with rendering(them):
            assert observing(them).acts_in is SceneMode.RENDER and observing(them).public.position < them.position(0)
        assert missed, "with the lease it learns that there is more"

    assembled(4, main)


def test_after_it_consented_nothing_begins_before_the_switch() -> None:
    async def main(them: Assembly) -> None:
        await observed(them)
        await switched(them, RENDER, OBSERVER, within_s=T_WAIT_S)
        asked = RequestSceneLog(them.scene, them.genesis, them.position(0), 0, Want.CONSENT)
        assert use(them).consents(asked, them.of(1).me) is not None
        began = trio.current_time()
        async with rendering(them):
            assert trio.current_time() - began > 3.0, "until nobody goes on with that change"
        with pytest.raises(Refused) as told:
            use(them).consents(asked, them.of(4).me)
        assert told.value.reason is RejectReason.NOT_AUTHORISED, "who decides nothing asks for nothing"

    assembled(5, main)


def test_who_is_cut_off_is_passed_over_and_waited_for() -> None:
    async def main(them: Assembly) -> None:
        await observed(them)
        await switched(them, RENDER, OBSERVER, within_s=T_WAIT_S)
        net, me = them.cluster.net, them.of(OBSERVER).me
        ours = [them.node(slot).address for slot in range(3)]
        ended: list[Refused] = []

        async def render() -> None:
            try:
                async with use(them).hold(SceneMode.RENDER):
                    await trio.sleep_forever()
            except Refused as refused:
                ended.append(refused)

        async with trio.open_nursery() as nursery:
            nursery.start_soon(render)
            await them.until(lambda: observing(them).acts_in is SceneMode.RENDER)
            await trio.sleep(1.0)
            parted = net.partition(ours, [them.node(OBSERVER).address])
            await them.until(lambda: me not in them.of(0).roster.alive(), 120.0)
            took = await switched(them, EDIT, within_s=T_WAIT_S + 5.0)
            assert ended and ended[0].reason is RejectReason.MODE_FORBIDS, "its lease was over before anybody could edit"
            assert took > T_WAIT_S - 1.0, "nobody knows that it uses nothing more"
            net.unite(parted)
        await them.until(lambda: observing(them).public.mode is SceneMode.EDIT, 120.0)
        await them.until(lambda: me in them.of(0).roster.alive(), 120.0)
        assert await switched(them, RENDER, OBSERVER, within_s=T_WAIT_S) < T_WAIT_S / 2, "it is there again"

    assembled(4, main)


def test_who_lives_and_does_not_answer_is_named_unless_it_is_forced() -> None:
    async def main(them: Assembly) -> None:
        await observed(them)
        observer = them.of(OBSERVER)

        async def deaf(packet: RequestSceneLog, peer: str) -> Packet:
            await trio.sleep_forever()
            raise AssertionError

        observer.participation.on_lease = deaf  # type: ignore[method-assign]
        no = await refusal(them, 0, RENDER)
        assert (no.reason, no.node) == (RejectReason.PEER_MISSED, observer.me) and 0 < no.silent_ms < 10_000
        assert isinstance(await them.change(0), AcceptSceneProposal), "other entries go on"
        assert isinstance(await them.change(0, RENDER, forced=True), AcceptSceneProposal)

    assembled(4, main)


def test_a_participant_that_lives_and_does_not_answer_is_named() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await trio.sleep(T_WAIT_S)
        one = them.of(2).participation.of(them.scene)
        assert one is not None
        one.log.receive = lambda *_: None  # type: ignore[method-assign]
        no = await refusal(them, 0, RENDER)
        assert (no.reason, no.node) == (RejectReason.PEER_MISSED, them.of(2).me) and 0 < no.silent_ms < 10_000
        assert isinstance(await them.change(0), AcceptSceneProposal), "two of three agree about other entries"
        assert isinstance(await them.change(0, RENDER, forced=True), AcceptSceneProposal)

    assembled(3, main)


def test_who_is_gone_for_good_is_removed_and_waited_for_no_more() -> None:
    async def main(them: Assembly) -> None:
        await observed(them)
        entry = them.entry(OBSERVER)
        them.crash(OBSERVER)
        await them.until(lambda: entry.member.node not in them.of(0).roster.alive(), 120.0)
        assert await switched(them, RENDER, within_s=T_WAIT_S + 5.0) > T_WAIT_S - 1.0
        await them.commits(0, RemoveObserver(entry.member))
        assert await switched(them, EDIT, within_s=T_WAIT_S + 5.0) > T_WAIT_S - 5.0, "it was removed a moment ago"
        await trio.sleep(T_WAIT_S)
        assert await switched(them, RENDER, within_s=T_WAIT_S) < T_WAIT_S / 2

    assembled(4, main)


def test_force_cuts_its_render_and_nobody_acts_in_both_modes() -> None:
    async def main(them: Assembly) -> None:
        await observed(them)
        await switched(them, RENDER, OBSERVER, within_s=T_WAIT_S)
        ended: list[float] = []

        async def render() -> None:
            with pytest.raises(Refused, match="force"):
                async with use(them).hold(SceneMode.RENDER):
                    await trio.sleep_forever()
            ended.append(trio.current_time())

        async with trio.open_nursery() as nursery:
            nursery.start_soon(render)
            await them.until(lambda: observing(them).acts_in is SceneMode.RENDER)
            await trio.sleep(1.0)
            assert (await refusal(them, 0, EDIT)).reason is RejectReason.BUSY
            assert isinstance(await them.change(0, EDIT, forced=True), AcceptSceneProposal)
            await them.until(lambda: all(modes(them, slot).is_active for slot in range(3)), T_WAIT_S / 2)
            assert ended, "first it let go of what it held, then they were told so"

    assembled(4, main)


def test_observers_count_in_no_majority() -> None:
    async def main(them: Assembly) -> None:
        await observed(them, 3, 4)
        them.crash(1, 2)
        await trio.sleep(T_WAIT_S)
        no = await refusal(them, 0, RENDER)
        assert no.reason in (RejectReason.NO_MAJORITY, RejectReason.NOT_READY)
        for slot in (3, 4):
            with pytest.raises(Refused) as told:
                async with use(them, slot).hold(SceneMode.EDIT):
                    pass
            assert told.value.reason is RejectReason.MODE_FORBIDS, "one of three grants no lease"
        await them.start(1)
        await them.until(lambda: them.takes_part(1))
        assert isinstance(await them.change(0), AcceptSceneProposal), "two of three are a majority, whoever observes"

    assembled(5, main)


def test_an_observer_that_starts_anew_is_waited_for_no_longer() -> None:
    async def main(them: Assembly) -> None:
        await observed(them)
        await switched(them, RENDER, OBSERVER, within_s=T_WAIT_S)
        me = them.of(OBSERVER).me
        them.crash(OBSERVER)
        await them.until(lambda: me not in them.of(0).roster.alive(), 120.0)
        position = await them.commits(0, EDIT)
        began = trio.current_time()
        await them.start(OBSERVER)
        await them.everybody_at(position, OBSERVER)
        await them.until(lambda: all(modes(them, slot).is_active for slot in range(3)), T_WAIT_S)
        assert trio.current_time() - began < T_WAIT_S - 1.0

    assembled(4, main)
