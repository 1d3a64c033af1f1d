"""If this fails, a client believes a node that hides a revocation, talks to who was revoked, or is kept busy by claims."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgpack
import pytest
import trio
import trio.testing

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import KeyId, node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.client import known_log
from scenefold.client.calls import Calls
from scenefold.client.known_log import LOOK_S, PAUSE_S, KnownLog
from scenefold.crypto import HEADER_DOMAIN, LOG_DOMAIN
from scenefold.peer.cluster_log.log_packets import answer_of
from scenefold.wire import MiniStatus, Packet, RequestSceneLog, RequestTable, RespondSceneLog, RespondTable, SignedRecord, pack_log
from scenefold.world import Priority
from scenefold.world.log_file import LogFile
from scenefold.world.log_view import LogView
from unit.client.fake_nodes import make_world
from unit.peer.logs_made import LOG_KEY, facts, key_of, node
from unit.peer.members_made import NEWCOMERS
from unit.world.test_log_view import NODE, RECORDS

ADDRESSES = ("127.0.0.2", "127.0.0.3", "127.0.0.4")
VOTER = ADDRESSES[0]
FACTS = facts(3)
GENESIS = FACTS.genesis_header
ME = ("user:ada", NEWCOMERS[2].signing.key_id)


def header(position: int) -> Any:
    bare = replace(GENESIS, position=position)
    return replace(bare, signature=LOG_KEY.sign(HEADER_DOMAIN, bare.signable()))


@dataclass
class Nodes:
    """The links to three nodes; each has a log, and claims to be as far as it likes."""

    logs: dict[str, Sequence[SignedRecord]] = field(default_factory=lambda: dict.fromkeys(ADDRESSES, RECORDS))
    claims: dict[str, int] = field(default_factory=dict)
    away: set[str] = field(default_factory=set)
    asked: list[str] = field(default_factory=list)
    part: int = 4

    async def request(self, address: str, _priority: Priority, packet: Packet, _timeout: float) -> Packet:
        await trio.lowlevel.checkpoint()
        if address in self.away:
            raise Unreachable("nobody there", where=address)
        mini = MiniStatus(1, node_id_of(address), None, 0, 0, 0, 0, 0, self.claims.get(address, 0))
        if isinstance(packet, RequestTable):
            return RespondTable((), mini_status=mini)
        assert isinstance(packet, RequestSceneLog)
        self.asked.append(address)
        log = self.logs[address]
        return RespondSceneLog(answer_of(header(len(log)), 0, pack_log(log[packet.have :][: self.part])), mini_status=mini)

    def client(self, folder: Path | None = None, me: tuple[str, KeyId] = ME) -> tuple[Calls, KnownLog]:
        links: Any = self
        calls = Calls(make_world(), links, ADDRESSES, [node_id_of(address) for address in ADDRESSES])
        file = None if folder is None else LogFile(folder)
        known = (LogView(), list[SignedRecord]()) if file is None else file.load()
        log = KnownLog(calls, GENESIS, LOG_KEY.public, FACTS.voter, me, file, known)
        calls.check_own, calls.heard = log.check_own, log.heard
        return calls, log


async def test_the_longest_of_several_logs_counts(autojump_clock: trio.testing.MockClock) -> None:
    for knows in ADDRESSES:
        nodes = Nodes(logs=dict.fromkeys(ADDRESSES, RECORDS[:5]) | {knows: RECORDS})
        _, log = nodes.client()
        assert (await log.newest()).position == len(RECORDS)
        assert set(nodes.asked) == set(ADDRESSES)


async def test_one_that_lies_speaks_for_nobody_else(autojump_clock: trio.testing.MockClock) -> None:
    nodes = Nodes(
        logs={VOTER: [*RECORDS[:3], replace(RECORDS[3], signature=bytes(64))], ADDRESSES[1]: RECORDS[:8], ADDRESSES[2]: RECORDS[:6]}
    )
    _, log = nodes.client()
    assert (await log.newest()).position == 8
    nodes.logs = dict.fromkeys(ADDRESSES, nodes.logs[VOTER])
    _, alone = nodes.client()
    with pytest.raises(PeerFault, match="does not verify"):
        await alone.newest()
    nodes.away = set(ADDRESSES)
    with pytest.raises(Unreachable):
        await alone.newest()


async def test_an_entry_that_this_program_does_not_know_says_that_it_is_old(autojump_clock: trio.testing.MockClock) -> None:
    plain = msgpack.unpackb(RECORDS[3].record)
    plain[-1][0] = 99
    record = msgpack.packb(plain)
    newer = SignedRecord(record, LOG_KEY.sign(LOG_DOMAIN, record))
    _, log = Nodes(logs={address: [*RECORDS[:3], newer] for address in ADDRESSES}).client()
    with pytest.raises(PeerFault, match=r"a kind that this program does not know \(99\), so a newer program wrote it") as told:
        await log.newest()
    assert told.value.remedy == "update this program" and "malformed" not in str(told.value)


async def test_a_revoked_node_is_refused_by_every_later_client_of_the_profile(
    tmp_path: Path, autojump_clock: trio.testing.MockClock
) -> None:
    revoked: Any = SimpleNamespace(peer=NODE, peer_key=key_of(1).public.key_id)
    nodes = Nodes()
    _, first = nodes.client(tmp_path)
    assert first.refusal_of(revoked) is None
    await first.newest()
    nodes.logs = dict.fromkeys(ADDRESSES, RECORDS[:5])
    _, later = nodes.client(tmp_path)
    for _ in range(2):
        refusal = later.refusal_of(revoked)
        assert refusal is not None and refusal.reason is RejectReason.KEY_REVOKED
        await later.newest()
    for key in (key_of(2).public.key_id, None):
        refusal = later.refusal_of(SimpleNamespace(peer=NODE, peer_key=key))  # type: ignore[arg-type]
        assert refusal is not None and refusal.reason is RejectReason.NOT_READY, "no certificate but that of a new enrolment brings it back"


async def test_who_was_revoked_itself_asks_nothing_more(tmp_path: Path, autojump_clock: trio.testing.MockClock) -> None:
    former = ("user:ada", NEWCOMERS[0].signing.key_id)
    nodes = Nodes()
    with pytest.raises(Refused):
        await nodes.client(tmp_path, former)[1].newest()
    asked = len(nodes.asked)
    calls, log = nodes.client(tmp_path, former)
    for ask in (log.newest, calls.refresh):
        with pytest.raises(Refused, match=r"the key of user:ada is revoked \(position 8") as caught:
            await ask()
        assert caught.value.reason is RejectReason.KEY_REVOKED
    assert len(nodes.asked) == asked


async def test_what_a_node_claims_to_know_is_asked_for_and_followed(autojump_clock: trio.testing.MockClock) -> None:
    nodes = Nodes(claims={ADDRESSES[1]: len(RECORDS)}, logs=dict.fromkeys(ADDRESSES, RECORDS[:2]) | {ADDRESSES[1]: RECORDS})
    calls, log = nodes.client()
    async with trio.open_nursery() as nursery:
        nursery.start_soon(log.run)
        await calls.ask(ADDRESSES[1], RequestTable(), RespondTable)
        await trio.testing.wait_all_tasks_blocked()
        assert log.view.position == len(RECORDS) and set(nodes.asked) == {ADDRESSES[1]}
        nursery.cancel_scope.cancel()


async def test_who_claims_more_and_more_is_asked_once_a_second_at_most(autojump_clock: trio.testing.MockClock) -> None:
    nodes = Nodes()
    calls, log = nodes.client()
    async with trio.open_nursery() as nursery:
        nursery.start_soon(log.run)
        for number in range(1000):
            nodes.claims[VOTER] = 10**9 + number
            await calls.ask(VOTER, RequestTable(), RespondTable)
            await trio.sleep(0.01)
        assert len(nodes.asked) <= 10 / PAUSE_S + len(RECORDS) / nodes.part + 2
        nursery.cancel_scope.cancel()


async def test_a_client_that_talks_to_one_node_for_long_asks_others_too(autojump_clock: trio.testing.MockClock) -> None:
    nodes = Nodes(logs=dict.fromkeys(ADDRESSES, RECORDS) | {VOTER: RECORDS[:5]})
    _, log = nodes.client()
    async with trio.open_nursery() as nursery:
        nursery.start_soon(log.run)
        await trio.sleep(LOOK_S + PAUSE_S)
        assert log.view.position == len(RECORDS)
        assert log.view.keys_of(node(0)) is not None
        nursery.cancel_scope.cancel()


def lying(nodes: Nodes, liar: str, shows: str) -> None:
    """From now on the liar claims to know more than anybody, and shows this instead."""
    honest = nodes.request

    async def request(address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if address != liar or not isinstance(packet, RequestSceneLog):
            return await honest(address, priority, packet, timeout)
        await trio.sleep(0.01)
        mini = MiniStatus(1, node_id_of(address), None, 0, 0, 0, 0, 0, 2**40)
        if shows == "a refusal":
            raise Refused(RejectReason.NOT_READY, "not now")
        if shows == "silence":
            await trio.sleep(timeout)
            raise Unreachable("no answer", where=address)
        if shows == "no log":
            return RespondSceneLog(None, mini_status=mini)
        return RespondSceneLog(answer_of(header(3), 0, pack_log([replace(RECORDS[0], signature=bytes(64))])), mini_status=mini)

    nodes.request = request  # type: ignore[method-assign]
    nodes.claims[liar] = 2**40


@pytest.mark.parametrize("others_claim", [True, False])
@pytest.mark.parametrize("shows", ["a refusal", "silence", "no log", "a forged log"])
@pytest.mark.parametrize("liar", ADDRESSES)
async def test_one_that_claims_what_it_cannot_show_keeps_no_revocation_from_an_open_client(
    liar: str, shows: str, others_claim: bool, autojump_clock: trio.testing.MockClock
) -> None:
    nodes = Nodes(claims=dict.fromkeys(ADDRESSES, len(RECORDS)) if others_claim else {})
    lying(nodes, liar, shows)
    calls, log = nodes.client()
    async with trio.open_nursery() as nursery:
        nursery.start_soon(log.run)
        for _ in range(int(LOOK_S) + 20):
            for address in ADDRESSES:
                await calls.ask(address, RequestTable(), RespondTable)
            await trio.sleep(1)
        assert log.view.position == len(RECORDS)
        nursery.cancel_scope.cancel()


async def test_a_short_command_waits_for_what_is_being_asked_already(tmp_path: Path, autojump_clock: trio.testing.MockClock) -> None:
    nodes = Nodes(claims={VOTER: len(RECORDS)}, part=100)
    at_once = nodes.request

    async def request(address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if isinstance(packet, RequestSceneLog):
            await trio.sleep(0.05)
        return await at_once(address, priority, packet, timeout)

    nodes.request = request  # type: ignore[method-assign]
    calls, log = nodes.client(tmp_path)
    async with trio.open_nursery() as nursery:
        nursery.start_soon(log.run)
        await calls.ask(VOTER, RequestTable(), RespondTable)
        await trio.sleep(0.02)
        await log.settled()
        nursery.cancel_scope.cancel()
    assert LogFile(tmp_path).load()[0].position == len(RECORDS)


def shown(number: int, key: KeyId | None) -> Any:
    return SimpleNamespace(peer=f"node:{node(number)}", peer_key=key)


async def test_a_certificate_that_the_log_does_not_know_is_talked_to_once_it_does(autojump_clock: trio.testing.MockClock) -> None:
    nodes = Nodes(logs=dict.fromkeys(ADDRESSES, RECORDS[:8]))
    _, log = nodes.client()
    foreign = KeyId(0x12345678)
    assert log.refusal_of(shown(0, foreign)) is None, "of nobody anything is known yet"
    await log.newest()
    for number in range(3):
        assert log.refusal_of(shown(number, key_of(number).public.key_id)) is None
    async with trio.open_nursery() as nursery:
        nursery.start_soon(log.run)
        await trio.sleep(PAUSE_S)
        nodes.logs = dict.fromkeys(ADDRESSES, RECORDS)
        refusal = log.refusal_of(shown(2, foreign))
        assert refusal is not None and "another key" in refusal.what
        # Its keys may be newer than what we know: then the log tells.
        await trio.sleep(2 * PAUSE_S)
        assert log.view.position == len(RECORDS)
        nursery.cancel_scope.cancel()
    for key in (foreign, None):
        assert log.refusal_of(shown(2, key)) is not None
    assert log.refusal_of(shown(7, foreign)) is None, "a spare, of which the log tells nothing yet"


@pytest.mark.parametrize("keys", [1, 10_000])
async def test_one_with_a_foreign_certificate_keeps_no_client_busy(
    keys: int, autojump_clock: trio.testing.MockClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(known_log, "PUZZLES_MAX", 4)
    nodes, foreign, looks = Nodes(), ADDRESSES[2], 10
    _, log = nodes.client()
    await log.newest()
    honest, tries = nodes.request, list[str]()

    async def request(address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if address == foreign:
            tries.append(address)
            refusal = log.refusal_of(shown(2, KeyId(1 + len(tries) % keys)))
            assert refusal is not None
            raise Unreachable(refusal.what, where=address)
        return await honest(address, priority, packet, timeout)

    nodes.request = request  # type: ignore[method-assign]
    nodes.asked.clear()
    with trio.move_on_after(looks * LOOK_S):
        await log.run()
    # Once a minute anyway, and once more for each certificate.
    most = 3 * (looks + 1) * (1 + min(keys, 4))
    assert len(nodes.asked) <= most and len(tries) <= most
