"""If this fails, one enrolled node can fill the cluster's log, or one that only crashes a lot is kept out."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.beginnings import AGAIN_S, AT_ONCE, Beginnings
from scenefold.peer.timing import T_WAIT_S
from scenefold.wire import LogEntry
from scenefold.world.buckets import KEYS_MAX
from scenefold.world.sim import run_simulated
from unit.peer.log_cluster import LogCluster, log_cluster
from unit.peer.logs_made import add, member, node, remove

ME = node(1)


def is_let_in(beginnings: Beginnings, who: NodeId, now: float) -> bool:
    try:
        beginnings.check(who, now)
    except Refused:
        return False
    beginnings.count(who, now)
    return True


@given(st.lists(st.tuples(st.floats(0, 40), st.booleans()), max_size=400))
def test_nobody_begins_anew_more_often_than_the_bound_and_nobody_else_feels_it(steps: list[tuple[float, bool]]) -> None:
    beginnings, now, let_in, others = Beginnings(), 0.0, list[float](), list[float]()
    for pause, is_mine in steps:
        now += pause
        if is_mine and is_let_in(beginnings, ME, now):
            let_in.append(now)
        if not is_mine and (not others or now - others[-1] >= AGAIN_S):
            others.append(now)
            assert is_let_in(beginnings, node(2), now)
    for first, begun in enumerate(let_in):
        for count, at in enumerate(let_in[first:], 1):
            assert count <= AT_ONCE + (at - begun) / AGAIN_S + 1e-6


@given(st.lists(st.floats(0, 1), max_size=AT_ONCE), st.lists(st.floats(AGAIN_S, 10 * AGAIN_S), max_size=50))
def test_a_storm_of_crashes_and_then_a_life_that_is_hard_is_never_held_back(storm: list[float], later: list[float]) -> None:
    beginnings, now = Beginnings(), 0.0
    for pause in (*storm, *later):
        now += pause
        assert is_let_in(beginnings, ME, now)


def test_a_node_that_is_wiped_at_every_crash_is_not_held_back_for_a_quarter_of_an_hour() -> None:
    beginnings = Beginnings()
    assert all(is_let_in(beginnings, ME, life * T_WAIT_S) for life in range(int(15 * 60 / T_WAIT_S)))


def test_asking_while_it_waits_puts_nothing_off() -> None:
    beginnings = Beginnings()
    assert all(is_let_in(beginnings, ME, 0.0) for _ in range(AT_ONCE))
    assert not any(is_let_in(beginnings, ME, float(second)) for second in range(int(AGAIN_S)))
    with pytest.raises(Refused) as caught:
        beginnings.check(ME, 0.0)
    assert caught.value.reason is RejectReason.BUSY
    assert is_let_in(beginnings, ME, AGAIN_S)


def test_a_crowd_of_nodes_takes_no_room_without_end() -> None:
    beginnings = Beginnings()
    for number in range(3 * KEYS_MAX):
        assert is_let_in(beginnings, NodeId(number + 1), 0.0)
    assert len(beginnings._buckets._left) <= KEYS_MAX


# ------------------------------------------------------------------------------------------------------------- at the voter


def committed(entries_of: Callable[[int], list[LogEntry]], pause_s: float) -> tuple[int, int, list[str]]:
    """Of a spare that proposes these entries life by life: lives that were let in, the end of the log, and what it was told."""

    async def main() -> tuple[int, int, list[str]]:
        async with log_cluster(1, 2, 1) as cluster:
            await cluster.start(0, 1)
            await cluster.members(0, 1)
            return await flood(cluster)

    async def flood(cluster: LogCluster) -> tuple[int, int, list[str]]:
        voter = cluster.nodes[0].log._voter
        assert voter is not None
        let_in, told, request = 0, set[str](), 0
        for life in range(2 * AT_ONCE):
            try:
                for entry in entries_of(life):
                    request += 1
                    await voter.decide(entry, request.to_bytes(16, "big"), node(2))
                let_in += 1
            except Refused as refusal:
                told.add(f"{refusal.reason.name}: {refusal.what}")
            await trio.sleep(pause_s)
        return let_in, cluster.nodes[0].log.registry.position, sorted(told)

    return run_simulated(1, main, virtual_s_max=36_000, wall_s_max=60)


def registered(life: int) -> LogEntry:
    return replace(add(2, left_of=1, life=life), member=member(2, life))


@pytest.mark.expect_log("has begun anew too often lately")
def test_who_comes_and_goes_without_end_does_not_fill_the_log(caplog: pytest.LogCaptureFixture) -> None:
    let_in, position, told = committed(lambda life: [registered(life), remove(2, life)], 0.1)
    assert let_in == AT_ONCE and position <= 3 + 2 * AT_ONCE
    assert len(told) == 1 and told[0].startswith("BUSY: ") and "begun anew too often" in told[0]
    assert sum(record.levelno == logging.WARNING for record in caplog.records) == 1, "whoever runs the cluster is told, once a minute"


@pytest.mark.expect_log("has begun anew too often lately")
def test_who_only_changes_its_incarnation_without_end_does_not_fill_the_log_either() -> None:
    let_in, position, _ = committed(lambda life: [registered(life)], T_WAIT_S + 1)
    assert let_in < AT_ONCE + 2 * AT_ONCE * (T_WAIT_S + 1) / AGAIN_S + 1 and position <= 3 + 2 * let_in
    assert let_in < 2 * AT_ONCE


def test_nobody_is_held_back_from_leaving() -> None:
    entries = {life: [registered(life)] if life < AT_ONCE else [remove(2, AT_ONCE - 1)] for life in range(2 * AT_ONCE)}
    let_in, _, told = committed(lambda life: entries[life], T_WAIT_S + 1)
    assert let_in == AT_ONCE + 1, told
