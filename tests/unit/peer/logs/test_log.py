"""If this fails, a node runs a log otherwise than the machine means it: it shows what is not durable, forgets who asks, or stays behind."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import pytest
import trio

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Certificate, Decide, Judge, Learn, Outcome, Propose, Value
from scenefold.consensus.timing import Timing
from scenefold.peer.logs import Answer, Owner
from scenefold.peer.logs.asking import WAITING_MAX
from scenefold.store.layout import LOGS, NOTES
from scenefold.store.log_rows import decided_key, unpack_decided, votes_key
from scenefold.store.logs import Beside
from scenefold.store.sealing import opened
from scenefold.wire import Ballot, Phase, ProposalId
from scenefold.world.sim import CALM, Point, Weather, run_simulated
from unit.consensus.logs_made import GENESIS
from unit.peer.logs import town as town_module
from unit.peer.logs.town import Node, Town, _Wire, request_maker, until
from unit.peer.logs.watch import log_on, slot_on


def in_town(
    count: int, main: Callable[[Town], Awaitable[None]], weather: Weather = CALM, seed: int = 1, owner: Owner | None = None
) -> Town:
    """`main` in a town whose nodes all run; the laws must hold throughout."""

    async def run() -> Town:
        town = Town(seed, weather, sees_cracks=True)
        town.owner = owner or town.owner
        async with trio.open_nursery() as nursery:
            await town.found(count, nursery)
            for node in town.nodes.values():
                town.start(node)
            assert await until(lambda: len(town.up()) == count)
            await main(town)
            nursery.cancel_scope.cancel()
        town.watch.judge_history()
        assert not town.ends, town.ends
        return town

    return run_simulated(seed, run, virtual_s_max=2_000, wall_s_max=60)


async def ask(node: Node, request: str | None, within_s: float = 10.0, **more: Any) -> Answer:
    assert node.log is not None
    make: Any = None if request is None else request_maker(request, node)
    return await node.log.ask(make, within_s, **more)


def logs(town: Town) -> set[tuple[str, ...]]:
    return {tuple(log_on(node.disk)) for node in town.nodes.values()}


@pytest.mark.parametrize("count", [1, 2, 3, 7, 33])
def test_what_is_asked_for_is_decided_everywhere_in_the_order_of_asking(count: int) -> None:
    async def main(town: Town) -> None:
        asker = town.nodes[(count + 1) // 2]
        answers = [await ask(asker, request) for request in ("a", "b", "c")]
        assert [(answer.outcome, answer.position) for answer in answers] == [(Outcome.COMMITTED, at) for at in (1, 2, 3)]
        assert await until(lambda: logs(town) == {("a", "b", "c")})
        assert await ask(asker, "b") == Answer(Outcome.COMMITTED, 2), "asked for again"
        assert (await ask(town.nodes[1], None)).outcome is Outcome.OPEN, "a barrier, and nothing is under way"

    in_town(count, main)


def test_many_ask_at_once_at_all_nodes() -> None:
    async def main(town: Town) -> None:
        answers: dict[str, Answer] = {}

        async def one(node: Node, request: str) -> None:
            answers[request] = await ask(node, request, 120.0)

        async with trio.open_nursery() as nursery:
            for node in town.nodes.values():
                for number in range(8):
                    nursery.start_soon(one, node, f"{node.number}.{number}")
        assert {answer.outcome for answer in answers.values()} == {Outcome.COMMITTED}
        assert sorted(answer.position for answer in answers.values()) == list(range(1, 25))
        assert await until(lambda: len(logs(town)) == 1)

    in_town(3, main)


def test_who_asks_too_much_is_told_so_and_whoever_waits_hears_of_the_end() -> None:
    async def main(town: Town) -> None:
        asker = town.nodes[1]
        told: list[Answer | Refused] = []

        async def one(request: str) -> None:
            try:
                told.append(await ask(asker, request, 500.0))
            except Refused as refused:
                told.append(refused)

        for other in (town.nodes[2], town.nodes[3]):
            town.crash(other)
        async with trio.open_nursery() as nursery:
            for number in range(WAITING_MAX + 2):
                nursery.start_soon(one, f"r{number}")
            assert await until(lambda: bool(told))
            assert {getattr(one, "reason", None) for one in told} == {RejectReason.BUSY} and len(told) <= 2
            town.crash(asker)
        reasons = [answer.outcome if isinstance(answer, Answer) else answer.reason for answer in told]
        assert sorted(map(str, set(reasons))) == sorted(map(str, {RejectReason.BUSY, RejectReason.NOT_READY, Outcome.UNKNOWN}))
        assert reasons.count(Outcome.UNKNOWN) == 1, "the one that was proposed"

    in_town(3, main)


def test_without_a_majority_nothing_is_decided_and_the_answer_says_so() -> None:
    async def main(town: Town) -> None:
        for number in (2, 3):
            town.crash(town.nodes[number], silent=number == 2)
        answer = await ask(town.nodes[1], "alone", 3.0)
        assert (answer.outcome, answer.reason) == (Outcome.REJECTED, RejectReason.NO_MAJORITY)
        town.start(town.nodes[2])
        assert (await ask(town.nodes[1], "together")).outcome is Outcome.COMMITTED
        assert log_on(town.nodes[1].disk) == ["together"]

    in_town(3, main)


class Sleeper(Owner):
    """Of nodes that say nothing for a while after a start."""

    is_awake = True

    def speaks(self) -> bool:
        return self.is_awake


def test_what_silent_nodes_have_voted_for_is_taken_over_once_they_speak() -> None:
    """The power fails when three of five have voted, and nobody knows that it is decided; nothing else is ever asked for."""
    owner = Sleeper()

    async def main(town: Town) -> None:
        async def begin() -> None:
            await ask(town.nodes[2], "begun", 1.0)

        def voters() -> int:
            return sum(slot_on(node.disk)[1].accepted is not None for node in town.nodes.values())

        for number in (4, 5):
            town.crash(town.nodes[number], silent=True)
        async with trio.open_nursery() as nursery:
            nursery.start_soon(begin)
            assert await until(lambda: voters() == 3, look_s=0.0001)
            for node in town.nodes.values():
                town.crash(node)
        assert logs(town) == {()} and voters() == 3
        owner.is_awake = False
        for node in town.nodes.values():
            await node.gone.wait()
            town.start(node)
        assert await until(lambda: len(town.up()) == 5)
        await trio.sleep(1.0)
        owner.is_awake = True
        for node in town.nodes.values():
            assert node.log is not None
            node.log.restate()
        assert await until(lambda: logs(town) == {("begun",)}, 60.0)

    in_town(5, main, owner=owner)


def test_what_strangers_say_is_decided_later_is_not_kept() -> None:
    """Nobody can tell yet whether it is; each log of a node keeps megabytes of such."""

    async def main(town: Town) -> None:
        log = town.nodes[1].log
        assert log is not None
        ballot, value = Ballot(1, town.nodes[2].id), Value(b"later")
        later = [Learn(GENESIS, position, value, Certificate(position, ballot, ())) for position in (5, 6)]
        town.by_id[NodeId(99)] = town.nodes[3]
        log.receive(NodeId(99), later[0])
        log.receive(town.nodes[2].id, later[1])
        assert await until(lambda: bool(log._ahead._kept))
        assert list(log._ahead._kept) == [6]

    in_town(3, main)


@pytest.mark.parametrize("at_once_bytes", [0, 1024 * 1024], ids=["by the arms", "at once"])
def test_who_reaches_one_other_node_alone_decides_by_that_one(at_once_bytes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    def reaches(self: Town, source: Node, target: Node) -> bool:
        pair = {source.number, target.number}
        return 1 not in pair or 2 in pair

    send = _Wire._send

    async def send_if_reached(self: Any, target: NodeId, message: Any) -> None:
        if not self._town.reaches(self._node, self._town.by_id[target]):
            raise Unreachable("there is no way", where=str(target))
        await send(self, target, message)

    async def main(town: Town) -> None:
        monkeypatch.setattr(Town, "reaches", reaches)
        monkeypatch.setattr(_Wire, "_send", send_if_reached)
        for request in ("a", "b"):
            assert (await ask(town.nodes[1], request, 9.0)).outcome is Outcome.COMMITTED
        monkeypatch.undo()

    monkeypatch.setattr(town_module, "AT_ONCE_BYTES", at_once_bytes)
    in_town(5, main)


def test_who_waits_behind_others_is_answered_in_time() -> None:
    """Others have taken what was begun, and say nothing: what this node tries to bring to its end for half a minute is no reason to be silent."""

    async def main(town: Town) -> None:
        asker = town.nodes[1]
        for number in (2, 3):
            town.crash(town.nodes[number], silent=True)
        found: dict[str, tuple[Answer, float]] = {}

        async def one(request: str | None, after_s: float) -> None:
            await trio.sleep(after_s)
            began = trio.current_time()
            found[str(request)] = await ask(asker, request, 6.0), trio.current_time() - began

        async with trio.open_nursery() as nursery:
            for number in range(3):
                nursery.start_soon(one, f"r{number}", number * 0.5)
            nursery.start_soon(one, None, 2.0)
        assert {(answer.outcome, answer.reason) for answer, _ in found.values()} == {(Outcome.REJECTED, RejectReason.NO_MAJORITY)}
        assert max(took for _, took in found.values()) < 6.1

    in_town(3, main)


@pytest.mark.parametrize("point", list(Point))
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_the_proposer_dies_at_a_step_and_another_one_goes_on(point: Point, count: int) -> None:
    """Either nothing of it is left, or it is decided everywhere; and the next one follows within seconds."""

    async def main(town: Town) -> None:
        dying = town.nodes[2]
        town.crash_at(dying, point, count)
        with trio.move_on_after(5.0), suppress(Refused):
            await ask(dying, "orphan")
        town.crash(dying)
        began = town.net.now
        assert (await ask(town.nodes[4], "next", 20.0)).outcome is Outcome.COMMITTED
        assert town.net.now - began < 5.0
        assert await until(dying.gone.is_set)
        town.start(dying)
        assert await until(lambda: len(logs(town)) == 1)
        assert logs(town) <= {("orphan", "next"), ("next",)}
        assert all(slot_on(node.disk)[1].accepted is None for node in town.nodes.values())

    in_town(5, main)


def test_nobody_waits_for_a_node_that_lives_on_as_another_one() -> None:
    """It lost its disk. Packets come to it, and it says nothing, as it takes no part."""

    async def main(town: Town) -> None:
        lost = town.nodes[2]
        town.crash(lost, silent=True)
        town.replaced = frozenset({lost.id})
        began = trio.current_time()
        for request in "abc":
            assert (await ask(town.nodes[1], request, is_for_all=True)).outcome is Outcome.COMMITTED
        assert trio.current_time() - began < Timing().pass_s_min, "not even one pass was waited for"

    in_town(3, main)


def test_what_only_a_voter_knows_is_brought_to_an_end_by_it() -> None:
    """The originator and its one voter die before anybody else hears of the vote; the voter comes back, the originator does not."""

    async def main(town: Town) -> None:
        dying, voter = town.nodes[1], town.nodes[2]
        async with trio.open_nursery() as nursery:
            nursery.start_soon(ask, dying, "orphan", 60.0)
            assert await until(lambda: slot_on(voter.disk)[1].accepted is not None, look_s=0.0001)
            town.crash(voter)
            town.crash(dying, silent=True)
        assert await until(voter.gone.is_set)
        town.start(voter)
        others = [town.nodes[number] for number in range(2, 6)]
        assert await until(lambda: all(log_on(node.disk) == ["orphan"] for node in others))
        assert sum(node.log.taken_over for node in others if node.log is not None) >= 1

    in_town(5, main)


def test_a_full_disk_casts_no_vote_and_hands_on_what_others_say() -> None:
    async def main(town: Town) -> None:
        full = town.nodes[2]
        full.disk.fill(0)
        before = slot_on(full.disk)
        assert (await ask(town.nodes[1], "a")).outcome is Outcome.COMMITTED
        assert slot_on(full.disk) == before and log_on(full.disk) == []
        assert (await ask(full, "b")).reason is RejectReason.STORAGE_FULL
        town.nodes[3].disk.fill(0)
        answer = await ask(town.nodes[1], "c", 3.0)
        assert answer.outcome is not Outcome.COMMITTED, "two of three take nothing"
        for node in town.nodes.values():
            node.disk.fill(None)
        assert await until(lambda: len(logs(town)) == 1)
        assert (await ask(full, "d")).outcome is Outcome.COMMITTED

    in_town(3, main)


def test_who_was_away_catches_up_however_far_it_is_behind() -> None:
    async def main(town: Town) -> None:
        away = town.nodes[3]
        town.crash(away)
        for number in range(300):
            assert (await ask(town.nodes[1], f"r{number}")).outcome is Outcome.COMMITTED
        assert await until(away.gone.is_set)
        town.start(away)
        assert await until(lambda: len(log_on(away.disk)) == 300)
        assert (await ask(away, "now")).position == 301

    in_town(3, main)


@pytest.mark.expect_log("does not vote in that log")
@pytest.mark.parametrize("rotten", ["votes", "decided"])
def test_who_may_have_forgotten_votes_is_silent_until_others_have_decided(rotten: str) -> None:
    """Two of three are left that speak: they decide, the third learns, and takes part again behind what it may have voted for."""

    async def main(town: Town) -> None:
        for request in ("a", "b"):
            await ask(town.nodes[1], request)
        assert await until(lambda: logs(town) == {("a", "b")})
        hurt = town.nodes[2]
        town.crash(hurt)
        assert await until(hurt.gone.is_set)
        key = votes_key(GENESIS) if rotten == "votes" else decided_key(GENESIS, 2)
        assert hurt.disk.corrupt(LOGS, town.dice, key) == key
        # Its rows are judged by what was written, and of these some are not there any more.
        town.watch.minds_disks = False
        town.start(hurt)
        assert await until(lambda: hurt.log is not None)
        assert hurt.log is not None and hurt.log.is_silent
        assert (await ask(hurt, "mine", 2.0)).reason is RejectReason.NOT_AUTHORISED
        town.crash(town.nodes[3])
        assert (await ask(town.nodes[1], "c", 3.0)).outcome is not Outcome.COMMITTED, "one voice of three"
        assert await until(town.nodes[3].gone.is_set)
        town.start(town.nodes[3])
        assert await until(lambda: town.nodes[3].log is not None)
        assert (await ask(town.nodes[1], "d", 20.0)).outcome is Outcome.COMMITTED
        assert await until(lambda: hurt.log is not None and not hurt.log.is_silent)
        town.crash(town.nodes[3])
        assert (await ask(hurt, "e", 20.0)).outcome is Outcome.COMMITTED, "its vote counts again"

    in_town(3, main)


class Lean(Owner):
    """Keeps bodies of the newest position alone, and hears of all that is decided."""

    def __init__(self) -> None:
        self.heard: list[int] = []

    def leaner(self, value: Value) -> Value:
        return Value(value.data)

    def beside(self, decided: Decide, after: Judge) -> Beside:
        return Beside(notes={"newest": b"%d" % decided.position})

    def decided(self, decided: Decide, after: Judge) -> None:
        self.heard.append(decided.position)


def test_of_what_is_decided_only_the_newest_body_stays_and_what_follows_is_written_with_it() -> None:
    async def main(town: Town) -> None:
        owner = town.owner
        assert isinstance(owner, Lean)
        node = town.nodes[1]
        assert node.log is not None
        for request in ("a", "b", "c"):
            make = request_maker(request, node)
            with_body: Any = lambda judge, make=make: Value(make(judge).data, b"body")  # noqa: E731
            assert (await node.log.ask(with_body, 10.0)).outcome is Outcome.COMMITTED
        rows = node.disk.peek(LOGS)
        keys = [decided_key(GENESIS, position) for position in (1, 2, 3)]
        assert [unpack_decided(key, memoryview(rows[key])).value.body for key in keys] == [b"", b"", b"body"]
        assert bytes(opened(NOTES, b"newest", memoryview(node.disk.peek(NOTES)[b"newest"]))) == b"3"
        assert owner.heard == [1, 2, 3]
        town.crash(node)
        assert await until(node.gone.is_set)
        town.start(node)
        assert await until(lambda: node.log is not None)
        assert node.log is not None and node.log.position == 3
        assert (await ask(node, "d")).position == 4
        assert unpack_decided(keys[2], memoryview(node.disk.peek(LOGS)[keys[2]])).value.body == b""

    in_town(1, main, owner=Lean())


def test_whose_consent_is_asked_who_takes_no_part_does_not_say() -> None:
    """An owner does something about what it may consent to; anybody could make it do so, and for nothing."""

    class Asked(Owner):
        def __init__(self) -> None:
            self.values: list[Value | None] = []

        def veto(self, value: Value | None) -> RejectReason | None:
            self.values.append(value)
            return None

    owner = Asked()

    async def main(town: Town) -> None:
        node, other = town.nodes[1], town.nodes[2]
        assert node.log is not None
        value: Any = request_maker("it", other)(node.log.judge)
        stranger, everyone = NodeId(7), tuple(town.by_id)
        town.by_id[stranger] = other  # So what is answered comes somewhere.
        for sender, at, expected in ((stranger, 1, []), (other.id, 2, []), (other.id, 1, [value])):
            proposal = ProposalId(at, Ballot(1, stranger), Phase.PREPARE)
            node.log.receive(sender, Propose(GENESIS, proposal, everyone, (), value=value))
            await trio.sleep(0.5)
            assert owner.values == expected
        assert (await ask(other, "it")).outcome is Outcome.COMMITTED
        assert len(owner.values) == 3, "two others are asked"

    in_town(3, main, owner=owner)


def test_two_sides_of_a_crack() -> None:
    async def main(town: Town) -> None:
        nodes = town.nodes
        town.net.partition([nodes[1].address, nodes[2].address], [nodes[n].address for n in (3, 4, 5)])
        few = await ask(nodes[1], "few", 3.0)
        assert few.outcome is not Outcome.COMMITTED
        assert (await ask(nodes[4], "many")).outcome is Outcome.COMMITTED
        town.net.calm()
        assert await until(lambda: len(logs(town)) == 1 and logs(town) != {()})
        assert (await ask(nodes[1], "after")).outcome is Outcome.COMMITTED

    in_town(5, main)
