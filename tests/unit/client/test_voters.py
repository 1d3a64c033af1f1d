"""If this fails, a client believes what no majority of voters has decided, loses it from its profile, or asks voters for what they cannot do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import DamagedData, LocalFault, NotReached, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.client.orders import Orders
from scenefold.client.reports import NodeReport
from scenefold.client.voters import READY_S_MAX, Council, Voters
from scenefold.wire import AddParticipant, DecidedValue, RemoveNode, RemoveParticipant
from scenefold.wire.enrol_packets import Administer, Administered
from scenefold.wire.orders import Order
from scenefold.world.log_file import LogFile
from scenefold.world.log_view import KeptRecord, LogView
from unit.client.fake_nodes import make_world
from unit.client.test_health import report
from unit.peer.logs_made import LOG_KEY, key_of, member, node
from unit.peer.voters_made import GENESIS, Senate, dismissed


def told(senate: Senate) -> list[DecidedValue]:
    return [DecidedValue(proof.position, value, proof.ballot, proof.votes) for value, proof in senate.decided]


def begun(senate: Senate) -> LogView:
    return LogView().after(senate.records, LOG_KEY.public, GENESIS)[0]


def senate_that_decided() -> Senate:
    senate = Senate()
    senate.decide(RemoveNode(member(4), "gone"))
    senate.decide(dismissed(0), origin=1)
    return senate


def test_what_a_majority_decided_is_followed_and_who_votes_changes_with_it() -> None:
    senate = senate_that_decided()
    view, fresh = begun(senate).after(told(senate), LOG_KEY.public, GENESIS)
    assert view.head == senate.registry.head and fresh == told(senate)
    assert view.voters is not None and view.voters.nodes == {node(1), node(2)} and node(4) not in view.members
    assert view.after(told(senate), LOG_KEY.public, GENESIS) == (view, [])


def test_neither_the_key_nor_too_few_votes_nor_votes_of_another_cluster_count_behind_it() -> None:
    senate = senate_that_decided()
    view, decided = begun(senate), told(senate)
    newest, _ = view.after(decided[:2], LOG_KEY.public, GENESIS)
    for spoilt in (replace(decided[2], votes=decided[2].votes[:1]), replace(decided[2], ballot=replace(decided[2].ballot, counter=9))):
        with pytest.raises(DamagedData):
            newest.after([spoilt], LOG_KEY.public, GENESIS)
    with pytest.raises(DamagedData):
        newest.after(decided[2:], LOG_KEY.public, bytes(32))
    with pytest.raises(DamagedData, match="nobody votes yet"):
        LogView().after(decided, LOG_KEY.public, GENESIS)
    behind = Senate()
    behind.by_key(RemoveNode(member(4), "by who has stolen the key"))
    only_key = begun(Senate(voters=1))
    with pytest.raises(DamagedData):
        only_key.after(behind.records[-1:], LOG_KEY.public, GENESIS)


def test_a_profile_keeps_both_kinds_of_records(tmp_path: Path) -> None:
    senate = senate_that_decided()
    records: list[KeptRecord] = [*senate.records, *told(senate)]
    file = LogFile(tmp_path)
    file.save(senate.records)
    file.save(records)
    view, kept = file.load()
    assert kept == records and view.head == senate.registry.head and view.voters is not None
    file.save(records[:3])
    assert LogFile(tmp_path).load()[1] == records, "more was known already"
    (tmp_path / "members.log").write_bytes((tmp_path / "members.log").read_bytes()[:-40])
    with pytest.raises(LocalFault, match="damaged"):
        file.load()


class Nodes:
    """Voters that answer orders as they are told to."""

    def __init__(self) -> None:
        self.world = make_world()
        self.answers: dict[str, Exception] = {}
        self.rounds: list[dict[str, Exception]] = []
        self.asked: list[tuple[str, Any]] = []
        self.said: list[dict[NodeId, dict[str, Any] | Exception]] = []
        """What voters say of themselves each time they are asked; the last stays."""

    async def ask(self, address: str, packet: Administer, *_: object, **__: object) -> Administered:
        self.asked.append((address, Order.decode(packet.order).entry))
        if address in self.answers:
            raise self.answers[address]
        return Administered(position=20)

    async def reports(self, addresses: Sequence[str]) -> dict[str, NodeReport | ScenefoldError]:
        said = self.said.pop(0) if len(self.said) > 1 else self.said[0]
        told: dict[str, Any] = {address_of(who): what for who, what in said.items()}
        return {one: told[one] if isinstance(told[one], Exception) else report(one, None, **told[one]) for one in addresses}

    async def patiently(self, call: Any, **_: object) -> Any:
        """As often as it is said how they answer, and once at least."""
        while True:
            if self.rounds:
                self.answers = self.rounds.pop(0)
            try:
                return await call()
            except (Unreachable, Refused):
                if not self.rounds:
                    raise


def office(senate: Senate) -> tuple[Nodes, Voters]:
    view, _ = begun(senate).after(told(senate), LOG_KEY.public, GENESIS) if senate.decided else (begun(senate), ())
    return office_of(view)


def office_of(view: LogView) -> tuple[Nodes, Voters]:
    async def newest(**_: object) -> LogView:
        return view

    nodes = Nodes()
    known: list[NodeId] = [node(0)] if view.voters is None else sorted(view.voters.nodes)
    log: Any = SimpleNamespace(newest=newest, voters=known, has_grown=lambda: None)
    return nodes, Voters(log, Orders(nodes, bytes(16), "user:ada", key_of(9), log), node(0), nodes.reports, nodes.world.clock)  # type: ignore[arg-type]


def voters_of(view: LogView) -> list[NodeId]:
    assert view.voters is not None
    return sorted(view.voters.nodes)


async def test_the_first_voter_is_named_before_the_second() -> None:
    senate = Senate(voters=1)
    senate.records.pop()
    nodes, voters = office(senate)
    assert await voters.add(node(1))
    assert [entry for _, entry in nodes.asked] == [AddParticipant(member(number), key_of(number).public.raw) for number in (0, 1)]


async def test_an_order_goes_to_another_voter_if_one_is_away_or_cannot() -> None:
    nodes, voters = office(Senate())
    nodes.answers = {
        address_of(node(0)): NotReached("nobody there"),
        address_of(node(1)): Refused(RejectReason.NO_MAJORITY, "too few answer"),
    }
    assert await voters.remove(node(1))
    assert nodes.asked == [(address_of(node(number)), RemoveParticipant(member(1))) for number in range(3)]
    nodes.answers[address_of(node(2))] = Refused(RejectReason.LIMIT_EXCEEDED, "seven already")
    with pytest.raises(Refused, match="seven"):
        await voters.add(node(3))


def refusal(reason: RejectReason) -> Refused:
    return Refused(reason, "no")


@pytest.mark.parametrize(
    ("said", "expected", "words"),
    [
        (
            [refusal(RejectReason.NO_MAJORITY), NotReached("off"), NotReached("off")],
            Refused,
            "of 3 voters too few answer, and nothing was changed",
        ),
        ([NotReached("off"), NotReached("off"), refusal(RejectReason.NO_MAJORITY)], Refused, "too few answer"),
        ([refusal(RejectReason.NO_MAJORITY), Unreachable("may be"), NotReached("off")], Unreachable, "may be"),
        ([refusal(RejectReason.NO_MAJORITY), refusal(RejectReason.NOT_READY), NotReached("off")], Unreachable, "may have happened"),
        ([refusal(RejectReason.NO_MAJORITY), refusal(RejectReason.BUSY), NotReached("off")], Refused, "no$"),
        ([NotReached("a"), NotReached("b"), NotReached("c")], NotReached, "c"),
    ],
)
async def test_what_no_voter_has_carried_out_is_told_as_it_stands(said: list[Exception], expected: type[Exception], words: str) -> None:
    nodes, voters = office(Senate())
    nodes.answers = {address_of(node(number)): what for number, what in enumerate(said)}
    with pytest.raises(ScenefoldError, match=words) as told:
        await voters.remove(node(1))
    assert type(told.value) is expected


@pytest.mark.parametrize("taken", [Unreachable("no answer in time"), PeerFault("nonsense"), refusal(RejectReason.NOT_READY)])
async def test_what_a_voter_may_have_voted_for_is_refused_by_nobody_later(taken: Exception) -> None:
    """It dies before it answers; without it no majority is there, and with it, once it is back, the order is carried out."""
    nodes, voters = office(Senate())
    rounds: list[dict[int, Exception]] = [
        {0: taken, 1: refusal(RejectReason.NO_MAJORITY), 2: NotReached("off")},
        {0: NotReached("off"), 1: refusal(RejectReason.NO_MAJORITY), 2: NotReached("off")},
    ]
    nodes.rounds = [{address_of(node(number)): what for number, what in said.items()} for said in rounds]
    with pytest.raises(Unreachable, match="an order was lost, and it may have happened") as told:
        await voters.remove(node(1))
    assert type(told.value) is Unreachable
    assert "`scenectl cluster voters` shows what became of it" in told.value.remedy and "may be given again" in told.value.remedy


@pytest.mark.parametrize("last", [NotReached("off"), refusal(RejectReason.LIMIT_EXCEEDED)])
async def test_however_a_round_ends_behind_one_that_may_have_been_taken_nobody_knows(last: Exception) -> None:
    nodes, voters = office(Senate())
    nodes.rounds = [
        {address_of(node(number)): Unreachable("no answer in time") for number in range(3)},
        {address_of(node(number)): last for number in range(3)},
    ]
    with pytest.raises(Unreachable, match="may have happened; a later try"):
        await voters.add(node(3))


async def test_what_was_in_doubt_and_is_done_is_done() -> None:
    nodes, voters = office(Senate())
    nodes.rounds = [{address_of(node(number)): Unreachable("no answer in time") for number in range(3)}, {}]
    assert await voters.remove(node(1))


async def test_those_who_answer_are_waited_for_until_all_of_them_grant_leases(autojump_clock: MockClock) -> None:
    view, _ = begun(Senate()).after(told(Senate()), LOG_KEY.public, GENESIS)
    nodes, voters = office_of(view)
    first, second, third = voters_of(view)
    done, late = {"log_position": view.position}, {"log_position": view.position, "grants_leases": False}
    behind = {"log_position": view.position - 1, "grants_leases": True}
    silent = Unreachable("nobody there")
    nodes.said = [
        {first: done, second: late, third: behind},
        {first: done, second: done, third: behind},
        {first: done, second: done, third: silent},
    ]
    assert await voters.preparing() == [] and len(nodes.said) == 1
    assert await voters.council() == Council([first, second, third], [], [third])
    nodes.said = [{first: done, second: late, third: behind}]
    assert await voters.preparing(within_s=0.0) == [second, third]
    began = trio.current_time()
    assert await voters.preparing() == [second, third] and trio.current_time() - began < 2 * READY_S_MAX


async def test_one_voter_alone_is_asked_nothing() -> None:
    senate = Senate(voters=1)
    senate.records.pop()
    _, voters = office(senate)
    assert await voters.preparing() == ()


async def test_what_is_so_already_is_no_order() -> None:
    nodes, voters = office(Senate())
    assert not await voters.add(node(1)) and not await voters.remove(node(4)) and not nodes.asked


async def test_who_is_not_trusted_or_unknown_is_no_voter() -> None:
    nodes, voters = office_of(replace(begun(Senate()), roll=LogView().roll))
    for who, words in ((node(3), "not trusted"), (node(9), "no node of this cluster")):
        with pytest.raises(LocalFault, match=words):
            await voters.add(who)
    assert not nodes.asked


@pytest.mark.parametrize(
    ("voters", "preparing", "silent", "may_be_lost", "has_majority"),
    [
        (3, 0, 0, 1, True),
        (3, 0, 1, 0, True),
        (3, 0, 2, 0, False),
        (5, 0, 1, 1, True),
        (5, 1, 0, 0, True),
        (4, 0, 1, 0, True),
        (1, 0, 0, 0, True),
    ],
)
def test_those_that_are_silent_are_lost_already(voters: int, preparing: int, silent: int, may_be_lost: int, has_majority: bool) -> None:
    nodes = [node(number) for number in range(voters)]
    found = Council(nodes, nodes[:preparing], nodes[voters - silent :])
    assert (found.may_be_lost, found.has_majority) == (may_be_lost, has_majority)
