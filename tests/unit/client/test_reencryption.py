"""If this fails, records stay under a key that somebody has who must not, or a re-encryption undoes what others write."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as st
from trio.testing import MockClock

from scenefold.base.errors import LocalFault, Refused, Unreachable
from scenefold.base.location import LINE_LENGTH, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.progress import ProgressState
from scenefold.client.reencryption import Pace, Reencryption, under_older_keys
from scenefold.client.scene import Scene
from scenefold.client.sealing import Draft, seal_all
from scenefold.crypto import RecordHeader
from scenefold.scene.layout import FILES, GEOMETRY
from scenefold.wire import DAMAGED_RECORD, Packet, PutMany, RecordBytes, Role, SceneMode, SetMode
from scenefold.world import Priority
from unit.client.fake_nodes import FakeNodes
from unit.client.test_grants import Studio, card_of

COUNT = 300
PLACES = [Location.from_number(LINE_LENGTH * index // COUNT) for index in range(COUNT)]


@pytest.fixture
def studio(tmp_path: Path) -> Studio:
    return Studio(tmp_path)


async def filled(studio: Studio) -> Scene:
    scene = await studio.scenes(1).create("kitchen", copies=1)
    await scene.space(GEOMETRY).put_many((place, b"payload %d" % index) for index, place in enumerate(PLACES))
    return scene


def epochs(nodes: FakeNodes) -> set[int]:
    return {RecordHeader.decode(item.header).key_epoch for item in nodes.records.values()}


async def test_everything_lies_under_the_newest_key_afterwards_and_says_the_same(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await filled(studio)
    hall = await scene.create_space("hall", ((0.0,) * 3, (8.0,) * 3))
    (placed,) = await hall.put_all_at([((1.0, 1.0, 1.0), b"a chair")])
    await hall.translate((1.0, 0.0, 0.0))
    objects = await scene.create_space("objects", node_managed=True)
    thing = await objects.put_managed(b"a thing")
    await scene.space(GEOMETRY).delete(PLACES[7])
    before = (await hall.read([placed]))[0]
    await scene.rotate_key()
    shown: list[ProgressState] = []
    report = await scene.reencrypt(shown.append)
    assert epochs(studio.nodes) == {1}
    assert (report.renewed, report.walked, report.unreadable, report.walks) == (COUNT + 2, COUNT + 2, 0, 2)
    assert (shown[-1].done, shown[-1].total) == (COUNT + 2, COUNT + 2)
    fresh = await studio.kitchen(1)
    assert await fresh.space(GEOMETRY).get_many(PLACES[:8]) == [*(b"payload %d" % index for index in range(7)), None]
    after = (await fresh.space(hall.id).read([placed]))[0]
    assert before is not None and after is not None
    assert (after.payload, after.content_position) == (b"a chair", before.content_position)
    assert await fresh.space(objects.id).managed.get([thing]) == [b"a thing"]
    again = await fresh.reencrypt()
    assert (again.renewed, again.walks) == (0, 1)


async def test_a_scene_whose_key_never_changed_has_nothing_to_do(autojump_clock: MockClock, studio: Studio) -> None:
    assert (await (await filled(studio)).reencrypt()).document()["records"] == 0


async def test_it_goes_on_where_it_was_ended(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await filled(studio)
    await scene.rotate_key()
    with trio.CancelScope() as scope:

        def end(state: ProgressState) -> None:
            if state.done >= COUNT // 2:
                scope.cancel()

        await scene.reencrypt(end)
    assert epochs(studio.nodes) == {0, 1}
    left = sum(RecordHeader.decode(item.header).key_epoch == 0 for item in studio.nodes.records.values())
    report = await (await studio.kitchen(1)).reencrypt()
    assert (report.renewed, epochs(studio.nodes)) == (left, {1})


class Overtaken(FakeNodes):
    """Something happens between what a client reads and what it writes."""

    happens: Callable[[], Any] | None = None

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if isinstance(packet, PutMany) and self.happens is not None:
            happens, self.happens = self.happens, None
            await happens()
        return await super().request(address, priority, packet, timeout)


async def test_what_others_write_meanwhile_stays(autojump_clock: MockClock, studio: Studio) -> None:
    studio.nodes = nodes = Overtaken()
    scene = await filled(studio)
    await scene.grant(card_of(2), Role.WRITER)
    ada = await studio.kitchen(2)
    await scene.rotate_key()

    async def write() -> None:
        await ada.space(GEOMETRY).put_many([(place, b"ada's") for place in PLACES[:20]])
        await ada.space(GEOMETRY).delete(PLACES[20])

    nodes.happens = write
    report = await scene.reencrypt()
    assert report.overtaken == 21 and report.unreadable == 0
    assert await scene.space(GEOMETRY).get_many(PLACES[:22]) == [*[b"ada's"] * 20, None, b"payload 21"]
    assert epochs(nodes) == {1}


async def test_what_cannot_be_read_is_told_and_stays(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await filled(studio)
    await scene.rotate_key()
    nodes = studio.nodes
    nodes.rotten.add(PLACES[3])
    forged = nodes.records[GEOMETRY, PLACES[4]]
    nodes.records[GEOMETRY, PLACES[4]] = replace(forged, ciphertext=forged.ciphertext[:-1] + bytes([forged.ciphertext[-1] ^ 1]))
    stranger = bytearray(nodes.records[GEOMETRY, PLACES[5]].header)
    stranger[77] ^= 1
    nodes.records[GEOMETRY, PLACES[5]] = replace(nodes.records[GEOMETRY, PLACES[5]], header=bytes(stranger))
    report = await scene.reencrypt()
    assert (report.renewed, report.unreadable, len(report.complaints)) == (COUNT - 3, 3, 3)
    assert any("damaged at its owner" in complaint for complaint in report.complaints)


async def test_only_a_writer_does_it_and_only_in_edit_mode(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await filled(studio)
    await scene.grant(card_of(2), Role.READER)
    await scene.rotate_key()
    with pytest.raises(LocalFault, match="reading only"):
        await (await studio.kitchen(2)).reencrypt()
    await scene.access.change_log(lambda _: SetMode(SceneMode.RENDER))
    with pytest.raises(Refused) as refused:
        await scene.reencrypt()
    assert refused.value.reason is RejectReason.MODE_FORBIDS


async def test_a_node_that_is_away_ends_it_in_words_and_nothing_is_lost(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await filled(studio)
    await scene.rotate_key()
    studio.nodes.away.add("127.0.0.3")
    with pytest.raises(Unreachable):
        await scene.reencrypt()
    studio.nodes.away.clear()
    await scene.reencrypt()
    assert epochs(studio.nodes) == {1}
    assert await scene.space(GEOMETRY).get_many(PLACES) == [b"payload %d" % index for index in range(COUNT)]


async def test_a_dry_run_says_what_there_is_to_do_and_changes_nothing(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await filled(studio)
    position, before = studio.nodes.headers[scene.id].position, dict(studio.nodes.records)
    report = await scene.look_what_is_to_seal()
    assert (report.to_renew, report.key_epoch) == (0, 0), "there is one key only"
    report = await scene.look_what_is_to_seal(new_key=True)
    assert (report.to_renew, report.walked, report.renewed, report.key_epoch) == (COUNT, COUNT, 0, 1)
    assert report.bytes == sum(len(item.ciphertext) for item in before.values())
    assert (studio.nodes.headers[scene.id].position, studio.nodes.records) == (position, before)
    await scene.rotate_key()
    await scene.space(GEOMETRY).put_many((place, b"anew") for place in PLACES[:40])
    shown: list[ProgressState] = []
    report = await scene.look_what_is_to_seal(shown.append)
    assert (report.to_renew, report.document()["dry_run"], report.is_complete) == (COUNT - 40, True, True)
    assert (shown[-1].phase, shown[-1].done, epochs(studio.nodes)) == ("look", COUNT, {0, 1})
    assert (await scene.reencrypt()).renewed == COUNT - 40


async def test_only_those_who_may_do_it_are_told_what_there_is_to_do(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await filled(studio)
    await scene.grant(card_of(2), Role.WRITER)
    await scene.grant(card_of(3), Role.READER)
    with pytest.raises(LocalFault, match="reading only"):
        await (await studio.kitchen(3)).look_what_is_to_seal()
    ada = await studio.kitchen(2)
    assert (await ada.look_what_is_to_seal()).to_renew == 0
    with pytest.raises(LocalFault, match="only an owner"):
        await ada.look_what_is_to_seal(new_key=True)


async def test_it_goes_no_faster_than_it_may(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.space(FILES).put_many((place, bytes(1000)) for place in PLACES)
    await scene.rotate_key()
    begun = trio.current_time()
    await scene.reencrypt(bytes_per_s=10_000)
    assert trio.current_time() - begun > 2 * COUNT * 1000 / 10_000 - 20, "two walks"


@given(st.lists(st.tuples(st.floats(0, 5), st.integers(0, 10_000)), max_size=30), st.integers(100, 10_000))
def test_a_pace_is_kept_over_any_time(steps: list[tuple[float, int]], rate: int) -> None:
    pace, now, passed = Pace(float(rate)), 0.0, 0
    for idle, size in steps:
        now += idle
        now += pace.wait_s(now, size)
        assert passed <= rate * now + 1e-6, "what was let through before took its time"
        passed += size
    assert Pace(None).wait_s(0.0, 10**12) == 0.0


def test_a_damaged_record_is_under_no_older_key() -> None:
    assert under_older_keys([None, DAMAGED_RECORD, RecordBytes(bytes(64), b"no header", b"")], 3) == []


def test_the_time_that_is_left_is_said() -> None:
    state = Reencryption(1, begun=10.0, total=100, walks=1, walked=25, bytes=3 << 20)
    assert state.progress(20.0) == ProgressState("re-encrypt", 25, 100, "records, 3.0 MiB sealed anew", 30.0)


async def test_a_record_that_cannot_be_sealed_anew_ends_nothing(autojump_clock: MockClock, studio: Studio) -> None:
    """A writer signed one with a place in a space where nodes choose it, and one that no version is above; lying nodes keep them."""
    scene = await filled(studio)
    objects = await scene.create_space("objects", node_managed=True)
    await scene.grant(card_of(2), Role.WRITER)
    ada = (await studio.kitchen(2)).access
    assert ada.writer is not None
    identity = replace(ada.identity, position=2**64 - 1)
    (odd,) = seal_all(ada.identity, ada.writer, 1, [Draft(objects.id, PLACES[5], b"odd", None, 1, b"n" * 12, 1)])
    (last,) = seal_all(identity, ada.writer, 1, [Draft(GEOMETRY, PLACES[9], b"last", None, 1, b"m" * 12, 1)])
    studio.nodes.records[objects.id, PLACES[5]], studio.nodes.records[GEOMETRY, PLACES[9]] = odd, last
    await scene.rotate_key()
    report = await scene.reencrypt()
    left = [key for key, item in studio.nodes.records.items() if RecordHeader.decode(item.header).key_epoch == 0]
    assert sorted(left) == sorted([(objects.id, PLACES[5]), (GEOMETRY, PLACES[9])])
    assert (report.unreadable, len(report.complaints)) == (2, 2)
    assert report.ended and not report.is_complete and report.document()["complete"] is False


async def test_walks_that_end_before_one_found_nothing_are_not_called_complete(
    autojump_clock: MockClock, studio: Studio, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scenefold.client.reencrypting.WALKS_MAX", 1)
    scene = await filled(studio)
    assert (await scene.reencrypt()).is_complete, "there is one key only"
    await scene.rotate_key()
    assert not (await scene.reencrypt()).is_complete
    assert (await scene.reencrypt()).is_complete
