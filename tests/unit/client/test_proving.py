"""If one fails, `cluster health --prove` counts copies that nobody has, or misses those that are lost, older, forged or misplaced."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.ids import SceneId, SpaceId, node_id_of
from scenefold.base.location import Location
from scenefold.base.prefixes import AddressPrefix
from scenefold.client import proving
from scenefold.client.progress import ProgressState
from scenefold.client.proof import Proof, Verdict, in_short
from scenefold.client.proving import Proving
from scenefold.client.proving_reads import NodeReads
from scenefold.client.proving_scenes import ShownScene
from scenefold.client.reencryption import Pace
from scenefold.client.scene import Scene
from scenefold.client.table import Owner
from scenefold.client.verifying import WriterKey
from scenefold.crypto import SigningKey
from scenefold.scene.log import EpochKeys, Layouts
from scenefold.wire import Configuration, CopiesFound, Copy, CopyState, GetCopies, Member, Packet, RecordBytes, SpaceEntry, Status
from unit.client.test_copy_reads import LAYOUTS, THIRDS, HoldingNodes, kept_scene
from unit.client.test_records import FILES, ITEMS, PLACES, WRITER, _scene

SHOWN = ShownScene("kitchen", SceneId(9), bytes(32), 1, {WRITER.key_id: WriterKey.always(WRITER.public)}, LAYOUTS)
FOUR = ("127.0.0.2", "127.0.0.3", "127.0.0.4", "127.0.0.5")


@dataclass
class ProvedNodes(HoldingNodes):
    digests_alone: set[str] = field(default_factory=set)
    """They say the digests of what they should have, and show nothing."""
    strays: dict[str, dict[Location, RecordBytes]] = field(default_factory=dict)
    """What nodes have by no right, and hold in custody for nobody."""
    blacklists: dict[str, tuple[AddressPrefix, ...]] = field(default_factory=dict)

    def _answer(self, address: str, packet: Packet) -> Packet:
        if isinstance(packet, GetCopies) and address in self.digests_alone:
            packet = replace(packet, digests_only=True)
        if isinstance(packet, GetCopies) and packet.any_copy and address in self.strays:
            return self._strays_of(address, packet)
        return super()._answer(address, packet)

    def _strays_of(self, address: str, packet: GetCopies) -> Packet:
        """As of a node that holds nothing for others."""
        found = [self.strays[address].get(key.location) for key in packet.keys]
        alone = Configuration(0, (Member(node_id_of(address), bytes(16)),), 1)
        copies = [Copy(CopyState.NO_CUSTODY, 0, b"", None) if one is None else Copy(CopyState.RECORD, 0, b"", one) for one in found]
        return CopiesFound((alone,), tuple(copies))

    def _status(self, owner: Owner) -> Status:
        return replace(super()._status(owner), blacklist=self.blacklists.get(owner.address, ()))


async def proved(nodes: ProvedNodes, shown: ShownScene = SHOWN, *, silent: tuple[str, ...] = (), rate: float | None = None) -> Proof:
    calls = nodes.calls()
    told: list[ProgressState] = []
    reads = NodeReads(calls, Pace(rate), list(map(node_id_of, silent)))
    proof = await Proving(calls, [shown], reads, told.append, total=len(ITEMS)).run()
    assert [(state.done, state.total) for state in told if state.total is not None and state.done >= state.total] == [
        (proof.records, proof.records)
    ]
    assert told[-1].done == proof.records
    assert [state.done for state in told] == sorted(state.done for state in told), "never less than before"
    assert proof.document()["sound"] == proof.is_sound
    return proof


def all_of(proof: Proof) -> list[tuple[tuple[int, int, int], int]]:
    assert all(not elsewhere for *_, elsewhere in proof.counts)
    return sorted(((wanted, valid, domains), count) for (wanted, valid, domains, _), count in proof.counts.items())


def holder_of(nodes: ProvedNodes, place: Location) -> str:
    return next(address for address in nodes.addresses if address != nodes.table.owner_of(place).address)


def other_bytes(record: RecordBytes) -> RecordBytes:
    return replace(record, ciphertext=record.ciphertext[:-1] + bytes([record.ciphertext[-1] ^ 1]))


async def test_all_copies_are_read_and_counted_on_all_nodes(autojump_clock: MockClock) -> None:
    nodes = ProvedNodes(reply_records_max=4)
    await kept_scene(nodes)
    proof = await proved(nodes)
    assert (proof.is_sound, all_of(proof), proof.opened) == (True, [((3, 3, 3), len(ITEMS))], 0)
    assert proof.bytes == 3 * sum(len(item.ciphertext) for item in nodes.records.values())
    with_key = await proved(nodes, replace(SHOWN, keys=EpochKeys.only(bytes(24))))
    assert (with_key.is_sound, with_key.opened) == (True, len(ITEMS))
    other_key = await proved(nodes, replace(SHOWN, keys=EpochKeys.only(b"k" * 24)))
    assert (other_key.corrupt, other_key.lost) == (len(ITEMS), len(ITEMS)), "what does not open is none"


async def test_who_says_digests_and_has_no_bytes_is_found(autojump_clock: MockClock) -> None:
    nodes = ProvedNodes(digests_alone={"127.0.0.3"})
    await kept_scene(nodes)
    proof = await proved(nodes)
    held = [place for place in PLACES if nodes.table.owner_of(place).address != "127.0.0.3"]
    assert (proof.short, proof.corrupt, proof.lost) == (len(held), 0, 0)
    liar = node_id_of("127.0.0.3")
    assert all(finding.verdicts[liar] is Verdict.NOTHING for finding in proof.named)
    assert len(proof.named) == min(20, len(held))


async def test_what_is_looked_at_again_was_looked_at(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(proving, "CLIENT_GET_KEYS", 4)
    nodes = ProvedNodes(digests_alone={"127.0.0.3"})
    await kept_scene(nodes)
    assert (await proved(nodes)).short


async def test_a_copy_that_has_changed_or_is_forged_or_older_does_not_count(autojump_clock: MockClock) -> None:
    nodes = ProvedNodes()
    scene = await kept_scene(nodes)
    changed, forged, older, rotten = PLACES[1], PLACES[8], PLACES[15], PLACES[22]
    kept = nodes.kept[holder_of(nodes, changed)]
    kept[changed] = other_bytes(kept[changed])
    stranger = HoldingNodes()
    strange: Scene = _scene(stranger, SigningKey(b"q" * 32))
    await strange.space(FILES).put(forged, b"mine")
    (item,) = stranger.records.values()
    nodes.kept[holder_of(nodes, forged)][forged] = RecordBytes(item.signature, item.header, item.ciphertext)
    await scene.space(FILES).put(older, b"newer")
    nodes.rotten.add(rotten)
    proof = await proved(nodes)
    assert (proof.short, proof.corrupt, proof.lost) == (4, 3, 0)
    found = {finding.key[1]: finding for finding in proof.named}
    assert set(found) == {changed, forged, older, rotten}
    assert found[changed].verdicts[node_id_of(holder_of(nodes, changed))] is Verdict.CORRUPT
    assert found[forged].verdicts[node_id_of(holder_of(nodes, forged))] is Verdict.CORRUPT
    assert sorted(found[older].verdicts.values()) == [Verdict.OLDER, Verdict.OLDER, Verdict.VALID]
    assert found[rotten].verdicts[nodes.table.owner_of(rotten).node_id] is Verdict.CORRUPT


async def test_a_silent_node_hides_what_it_owns_and_its_copies_are_missing(autojump_clock: MockClock) -> None:
    nodes = ProvedNodes()
    await kept_scene(nodes)
    nodes.hung.add("127.0.0.3")
    theirs = [place for place in PLACES if nodes.table.owner_of(place).address == "127.0.0.3"]
    proof = await proved(nodes, silent=("127.0.0.3",))
    assert (proof.is_complete, [one.address for one in proof.unlisted]) == (False, ["127.0.0.3"])
    assert (proof.records, proof.short, proof.corrupt) == (len(PLACES) - len(theirs),) * 2 + (0,)
    with trio.fail_after(200):
        alike = await proved(nodes)
    assert (alike.records, alike.short) == (proof.records, proof.short), "that nobody knew it before costs some time"


async def test_what_is_handed_on_to_the_owner_is_counted_there(autojump_clock: MockClock) -> None:
    nodes = ProvedNodes()
    await kept_scene(nodes)
    calls = nodes.calls()
    await calls.learn()
    nodes.move_bounds()
    proving = Proving(calls, [SHOWN], NodeReads(calls, Pace(None)))
    found = await proving._look(0, [(FILES, place) for place in PLACES])
    assert all(finding.is_worth_another_look and not finding.is_owner_sure for finding in found)
    proof = await proved(nodes)
    assert (proof.is_sound, proof.records) == (True, len(PLACES))


async def test_a_copy_where_none_belongs_is_mis_placed(autojump_clock: MockClock) -> None:
    nodes = ProvedNodes(FOUR)
    await kept_scene(nodes)
    place = PLACES[2]
    owner, *holders = (nodes.table.owner_of(place).node_id, *nodes.table.holders_of(THIRDS, place))
    address = next(address for address in FOUR if node_id_of(address) == holders[0])
    del nodes.kept[address][place]
    proof = await proved(nodes)
    assert (proof.mis_placed, proof.short, proof.is_sound) == (1, 0, False)
    (finding,) = proof.named
    assert finding.key == (FILES, place) and finding.placed == (owner, *holders)
    assert finding.document()["problems"] == ["mis-placed"]


async def test_copies_that_lie_elsewhere_are_no_copies_in_place_and_are_told(autojump_clock: MockClock) -> None:
    """Of one record, no holder has custody: one has it as a stray, another one something older, a third what nobody signed."""
    nodes = ProvedNodes(FOUR)
    scene = await kept_scene(nodes)
    place = PLACES[2]
    owner = nodes.table.owner_of(place).address
    current, outdated, forger = (address for address in FOUR if address != owner)
    old = nodes.kept[outdated][place]
    await scene.space(FILES).put(place, b"newer")
    newer = nodes.records[FILES, place]
    new = RecordBytes(newer.signature, newer.header, newer.ciphertext)
    nodes.strays = {current: {place: new}, outdated: {place: old}, forger: {place: other_bytes(new)}}
    proof = await proved(nodes)
    finding = next(finding for finding in proof.named if finding.key == (FILES, place))
    said = {node_id_of(owner): Verdict.VALID, node_id_of(current): Verdict.ELSEWHERE, node_id_of(outdated): Verdict.OLDER}
    assert {node: verdict for node, verdict in finding.verdicts.items() if verdict is not Verdict.NOTHING} == said
    assert (finding.is_short, finding.is_lost, finding.is_corrupt) == (True, False, False)
    document = finding.document()
    assert (document["wanted"], document["valid"], document["elsewhere"]) == (3, 1, 1)
    assert proof.counts[3, 1, 1, 1] == 1 and proof.elsewhere == 1 == proof.document()["elsewhere"]
    (line,) = [line for line in in_short(proof.named) if place.hex() in line]
    assert f"short: 1 of 3 valid in place, 1 more copy lies elsewhere on {current} (" in line


async def test_a_stray_that_is_newer_makes_nothing_older_and_one_alone_is_not_lost(autojump_clock: MockClock) -> None:
    """It may be what its owner has refused; and where the owner's has rotted, it is all there is."""
    nodes = ProvedNodes()
    scene = await kept_scene(nodes)
    place, rotten = PLACES[2], PLACES[3]
    before = nodes.records[FILES, place]
    await scene.space(FILES).put(place, b"newer")
    item = nodes.records[FILES, place]
    nodes.records[FILES, place] = before
    nodes.rotten.add(rotten)
    owner = nodes.table.owner_of(place).address
    kept = nodes.kept[owner][rotten]
    new = RecordBytes(item.signature, item.header, item.ciphertext)
    nodes.strays = {address: {place: new, rotten: kept} for address in nodes.addresses}
    proof = await proved(nodes)
    found = {finding.key[1]: finding for finding in proof.named}
    assert found[place].verdicts[node_id_of(owner)] is Verdict.VALID
    assert not found[rotten].valid and found[rotten].elsewhere and not found[rotten].is_lost and proof.lost == 0


async def test_nodes_that_keep_away_from_each_other_are_of_one_failure_domain(autojump_clock: MockClock) -> None:
    nodes = ProvedNodes(FOUR)
    nodes.blacklists["127.0.0.2"] = (AddressPrefix(node_id_of("127.0.0.5"), 32),)
    await kept_scene(nodes)
    proof = await proved(nodes)
    assert proof.short == 0
    domains = {count for _, _, count, _ in proof.counts}
    assert domains == {2, 3}, "of two others and one of the pair; of one other and the pair"


async def test_one_copy_is_looked_for_at_the_owner_alone(autojump_clock: MockClock) -> None:
    nodes = ProvedNodes()
    await kept_scene(nodes)
    nodes.asked.clear()
    single = replace(SHOWN, layouts=Layouts.of([SpaceEntry(FILES, SpaceId(0), Location(bytes(20)), 1, 1, False, False)]))
    proof = await proved(nodes, single)
    assert (proof.is_sound, all_of(proof)) == (True, [((1, 1, 1), len(ITEMS))])
    assert not any(isinstance(packet, GetCopies) for _, packet in nodes.asked)
    wants_more = replace(single, layouts=Layouts.of([SpaceEntry(FILES, SpaceId(0), Location(bytes(20)), 3, 2, False, False)]))
    assert (await proved(nodes, wants_more)).short == len(ITEMS), "three were asked for, whatever there are shadows for"


async def test_it_reads_no_faster_than_it_is_told(autojump_clock: MockClock) -> None:
    nodes = ProvedNodes()
    await kept_scene(nodes)
    begun = trio.current_time()
    proof = await proved(nodes, rate=100.0)
    assert trio.current_time() - begun >= 0.9 * (proof.bytes - 64 * 100) / 100
    assert proof.seconds > 1


async def test_what_was_found_until_it_was_interrupted_is_kept(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(proving, "CLIENT_GET_KEYS", 4)
    nodes = ProvedNodes()
    await kept_scene(nodes)
    calls, proof = nodes.calls(), Proof()
    reads = NodeReads(calls, Pace(3 * sum(len(item.ciphertext) for item in nodes.records.values()) / 10))
    with trio.move_on_after(5):
        await proving.Proving(calls, [SHOWN], reads, proof=proof).run()
    assert 0 < proof.records < len(ITEMS) and proof.bytes
    assert not proof.ended and not proof.is_sound


async def test_what_is_deleted_while_it_is_looked_at_is_gone(autojump_clock: MockClock) -> None:
    nodes = ProvedNodes()
    await kept_scene(nodes)
    calls = nodes.calls()
    missing = Location.from_number(PLACES[3].number + 1)
    (finding,) = await Proving(calls, [SHOWN], NodeReads(calls, Pace(None)))._look(0, [(FILES, missing)])
    assert finding.is_gone and finding.is_worth_another_look
    proof = Proof()
    proof.add(finding)
    assert proof.records == 0
