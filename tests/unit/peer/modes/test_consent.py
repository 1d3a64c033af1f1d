"""If this fails, the mode changes under who edits or renders by a lease that a participant lent before it was started anew (specs/26-modes.md, The switch)."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import Refused
from scenefold.base.ids import KeyId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Value
from scenefold.peer.modes import Borrower
from scenefold.peer.modes.scene_modes import SceneModes
from scenefold.peer.timing import T_LEASE_S, T_WAIT_S
from scenefold.wire import LogEntry, SceneMode, SetMode
from unit.client.fake_nodes import make_world
from unit.scene.log.council import Council, node
from unit.scene.log.members import grant

CLIENT = Borrower(KeyId(1), bytes(16))


class Participant:
    """One of those who decide a scene, as it starts. What others say it does not hear."""

    def __init__(self, *, is_new: bool = False) -> None:
        self.council = Council()
        self.member = node(1).member
        own: Any = SimpleNamespace(member=self.member, me=self.member.node)
        nobody: Any = None
        self.modes = SceneModes(make_world(), nobody, own, self.council.header, lambda: None, is_new=is_new)

    def value(self, entry: LogEntry) -> Value:
        return self.council.value(self.council.offer(entry))

    def lends(self, for_s: float) -> None:
        standing = self.modes.standing
        self.modes.standing = replace(standing, lender=standing.lender.lend(CLIENT, for_s, trio.current_time()))


async def test_who_started_a_moment_ago_minds_a_switch_until_what_it_lent_before_is_over(autojump_clock: MockClock) -> None:
    one = Participant()
    switch, other = one.value(SetMode(SceneMode.RENDER)), one.value(grant(1))
    for passed_s, found in ((0.0, RejectReason.BUSY), (T_WAIT_S - 1.0, RejectReason.BUSY), (2.0, None)):
        autojump_clock.jump(passed_s)
        assert one.modes.veto(switch) is found
        assert one.modes.veto(other) is one.modes.veto(None) is None, "other entries go on"
        if found is None:
            one.modes.check_proposal(one.council.offer(SetMode(SceneMode.RENDER)).header)
        else:
            with pytest.raises(Refused) as told:
                one.modes.check_proposal(one.council.offer(SetMode(SceneMode.RENDER)).header)
            assert told.value.reason is found, "as acceptor and as proposer it says the same"


async def test_who_takes_part_for_the_first_time_has_lent_nothing(autojump_clock: MockClock) -> None:
    one = Participant(is_new=True)
    assert one.modes.veto(one.value(SetMode(SceneMode.RENDER))) is None


async def test_who_asks_nobody_is_proposed_all_the_same(autojump_clock: MockClock) -> None:
    """It is voted for as soon as nothing that was lent can be used any more."""
    one = Participant()
    switch = one.value(SetMode(SceneMode.RENDER))
    one.modes.check_proposal(one.council.offer(SetMode(SceneMode.RENDER)).header, forced=True)
    assert one.modes.abstains(switch)
    autojump_clock.jump(T_WAIT_S + 1.0)
    assert not one.modes.abstains(switch)


async def test_what_it_lent_itself_is_minded_until_it_is_given_back(autojump_clock: MockClock) -> None:
    one = Participant(is_new=True)
    switch = one.value(SetMode(SceneMode.RENDER))
    one.lends(T_LEASE_S)
    assert one.modes.veto(switch) is RejectReason.BUSY
    one.modes.standing = one.modes.standing.given_back(CLIENT)
    assert one.modes.veto(switch) is None
