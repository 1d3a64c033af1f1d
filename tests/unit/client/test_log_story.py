"""If this fails, somebody is told that a scene's log came to be as it did not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from trio.testing import MockClock

from scenectl.entry_text import entry_document, entry_text
from scenectl.scene_log import log_text
from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId, node_id_of
from scenefold.client.log_story import told, vouched
from scenefold.client.scene import Scene
from scenefold.wire import AddParticipant, Ballot, Batch, DecidedValue, Grant, KeyEpoch, LogValue, TranslateSpace
from unit.client.fake_council import FIVE, FakeCouncil
from unit.client.test_participants import STEP, hall_of

A, B, C, D, E = FIVE


async def scene_of(council: FakeCouncil, folder: Path) -> Scene:
    """Of seven positions: the first by the origin, then by votes, of three, later four and three again."""
    scene, hall = await hall_of(council, folder)
    await hall.translate(STEP)
    council.away = {A}
    await scene.add_participants([council.entry(node_id_of(D))])
    council.away.clear()
    council.tell(*council.has[B, scene.id])
    await hall.translate(STEP)
    await scene.remove_participant(node_id_of(B))
    await scene.rotate_key()
    return scene


async def test_each_entry_is_told_with_who_decided_it(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene = await scene_of(council, tmp_path)
    story = await scene.log()
    assert (story.position, story.before, story.seen_by) == (7, 0, node_id_of(A))
    kinds = [type(entry.record.entry).__name__ for entry in story.entries]
    assert kinds == ["Batch", "Batch", "TranslateSpace", "AddParticipant", "TranslateSpace", "RemoveParticipant", "KeyEpoch"]
    first, *others = story.entries
    assert (first.participants, first.vouched) == ((), None), "the origin decides the first alone"
    assert [len(entry.participants) for entry in others] == [3, 3, 3, 4, 4, 3]
    proposers = [entry.vouched.proposer for entry in others if entry.vouched is not None]
    assert proposers[:3] == [node_id_of(address) for address in (B, B, B)]
    by_two = others[2].vouched
    assert by_two is not None and by_two.voters == (node_id_of(B), node_id_of(C))
    assert by_two.seen_s is not None and by_two.seen_s == pytest.approx(1_700_000_000.0, abs=100)
    text = log_text(story)
    assert "127.0.0.5 decides, too" in text and "2 of 3: 127.0.0.3, 127.0.0.4" in text and "127.0.0.2 alone" in text
    assert "2023-11-14 22:13:20Z" in text and "a new key, epoch 1" in text and "as 127.0.0.2 has it" in text


async def test_the_newest_entries_alone_are_asked_for(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene = await scene_of(council, tmp_path)
    story = await scene.log(2)
    assert [entry.position for entry in story.entries] == [6, 7]
    assert all(entry.vouched is not None for entry in story.entries)


Bend = Callable[[list[DecidedValue]], list[DecidedValue]]
BENT: dict[str, tuple[Bend, str]] = {
    "a vote too few": (lambda them: [*them[:2], replace(them[2], votes=them[2].votes[:1]), *them[3:]], "majority"),
    "votes of another ballot": (lambda them: [*them[:2], replace(them[2], ballot=Ballot(9, NodeId(1))), *them[3:]], "majority"),
    "a header left out": (lambda them: [*them[:2], *them[3:]], "another header"),
    "headers in another order": (lambda them: [*them[:-2], them[-1], them[-2]], "another header"),
    "an older end": (lambda them: them[:-1], "another header"),
    "a header of another position": (lambda them: [*them[:-1], replace(them[-2], position=them[-1].position)], "another position"),
    "nonsense": (lambda them: [*them[:-1], replace(them[-1], value=LogValue(b"?", b"?"))], "hold together"),
}


@pytest.mark.parametrize("what", BENT)
async def test_what_a_node_makes_up_is_not_told(autojump_clock: MockClock, tmp_path: Path, what: str) -> None:
    council = FakeCouncil()
    scene = await scene_of(council, tmp_path)
    read = await scene.access.read_log()
    entries = told(read.header, read.log)
    assert [entry.vouched is None for entry in vouched(entries, read.header, council.story)] == [True] + 6 * [False]
    bend, why = BENT[what]
    with pytest.raises(DamagedData, match=why):
        vouched(entries, read.header, bend(council.story))
    council.story = bend(council.story)
    story = await scene.log()
    assert (story.seen_by, len(story.entries)) == (None, 7), "the log is proven without it"
    assert "Who decided is not told" in log_text(story)


async def test_signatures_of_former_keys_are_looked_at(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene = await scene_of(council, tmp_path)
    read = await scene.access.read_log()
    for at in range(7):
        records = list(read.log.records)
        records[at] = replace(records[at], signature=bytes(64))
        with pytest.raises(DamagedData):
            told(read.header, replace(read.log, records=tuple(records)))


async def test_no_key_of_a_scene_is_told(autojump_clock: MockClock, tmp_path: Path) -> None:
    scene = await scene_of(FakeCouncil(), tmp_path)
    records = [entry.record.entry for entry in (await scene.log()).entries]
    (epoch,) = (entry for entry in records if isinstance(entry, KeyEpoch))
    assert entry_document(epoch) == {"kind": "KeyEpoch", "epoch": 1}
    (added,) = (entry for entry in records if isinstance(entry, AddParticipant))
    assert entry_document(added)["member"] == {"address": D, "incarnation": bytes(16).hex()}
    (moved, _) = (entry for entry in records if isinstance(entry, TranslateSpace))
    assert entry_document(moved) == {"kind": "TranslateSpace", "space": moved.space, "offset": [1.0, 0.0, 0.0]}
    first = records[0]
    assert isinstance(first, Batch) and isinstance(first.entries[-1], Grant)
    document = entry_document(first)
    assert document["entries"][-1]["role"] == "owner" and document["entries"][0]["curve"] == "hilbert"
    assert entry_text(first).endswith(f"; and {len(first.entries) - 4} more")
