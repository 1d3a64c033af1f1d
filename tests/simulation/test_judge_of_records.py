"""If this fails, an acknowledged record may be gone, old or unreadable after the storm and the last look does not see it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from random import Random
from types import SimpleNamespace
from typing import Any

import pytest

from scenefold.base.errors import Unreachable
from scenefold.scene.layout import META, RENDERS
from scenefold.simulation import final, laws
from scenefold.simulation.final import judge_histories, read_everything
from scenefold.simulation.history import Histories, Listing, Outcome, Place, Version, Write
from scenefold.simulation.linearizable import Verdict
from scenefold.simulation.story import Violation
from scenefold.store.layout import RECORDS, object_of, record_key, spot_of
from simulation.quiet import Rest, at_rest, overwrite

Spoil = Callable[[Rest], Awaitable[None]]


def violations_after(spoil: Spoil) -> list[Violation]:
    """What the last look finds once something was done to a cluster at rest."""
    found: list[Violation] = []

    async def look(rest: Rest) -> None:
        await spoil(rest)
        rest.cluster.watch.committed(1)
        await read_everything(rest.cluster.watch, rest.client)
        judge_histories(rest.cluster.watch)
        found.extend(rest.cluster.watch.violations)

    at_rest(look)
    return found


def disk_of(rest: Rest) -> Any:
    return rest.cluster.nodes[1].disk


async def nothing(_rest: Rest) -> None:
    """All is well."""


async def gone(rest: Rest) -> None:
    """A record disappears from its owner's disk."""
    overwrite(disk_of(rest), RECORDS, rest.key(1, 2), None)


async def old(rest: Rest) -> None:
    """An older version takes a record's place."""
    key = rest.key(1, 2)
    before = disk_of(rest).peek(RECORDS)[key]
    await rest.scene.space(META).put(rest.places[2], b"newer")
    overwrite(disk_of(rest), RECORDS, key, before)


async def managed_gone(rest: Rest) -> None:
    """A record without a place of its own disappears."""
    for node in rest.cluster.nodes.values():
        for key in [key for key in node.disk.peek(RECORDS) if object_of(key)]:
            overwrite(node.disk, RECORDS, key, None)


async def managed_twice(rest: Rest) -> None:
    """A second record of an object lies with the node that decides about it."""
    for node in rest.cluster.nodes.values():
        for key, value in [pair for pair in node.disk.peek(RECORDS).items() if object_of(pair[0])]:
            spot = spot_of(key)
            beside = spot.place.location.next()
            assert beside is not None
            overwrite(node.disk, RECORDS, record_key(spot.place._replace(location=beside), spot.object), value)


def rot(rest: Rest) -> None:
    before, key = rest.cluster.watch.records(1), rest.key(1, 2)
    assert disk_of(rest).corrupt(RECORDS, Random(2), key) == key
    rest.cluster.watch.damaged(1, key, before)


async def rotten(rest: Rest) -> None:
    """A record rots: that is excused."""
    rot(rest)


async def written_anew(rest: Rest) -> None:
    """What rotted is written again."""
    rot(rest)
    await rest.scene.space(META).put(rest.places[2], b"anew")


async def gone_after_written_anew(rest: Rest) -> None:
    """And then it disappears: that it rotted once is no excuse."""
    await written_anew(rest)
    rest.cluster.watch.committed(1)
    overwrite(disk_of(rest), RECORDS, rest.key(1, 2), None)


async def other_is_gone(rest: Rest) -> None:
    """A record rots, and another one disappears."""
    rot(rest)
    overwrite(disk_of(rest), RECORDS, rest.key(1, 3), None)


async def deaf(rest: Rest) -> None:
    """Nobody answers."""

    async def unreachable(_keys: object) -> None:
        raise Unreachable("nobody answers")

    rest.client.scene = SimpleNamespace(access=SimpleNamespace(get=unreachable), space=rest.scene.space)  # type: ignore[assignment]


@pytest.mark.parametrize("spoil", [nothing, rotten, written_anew], ids=lambda spoil: spoil.__name__)
def test_what_is_right_or_excused_is_no_violation(spoil: Spoil) -> None:
    assert violations_after(spoil) == []


@pytest.mark.parametrize(
    ("spoil", "law", "said"),
    [
        (gone, laws.READABLE, "c reads nothing at "),
        (old, laws.LINEARIZABLE, "c reads "),
        (managed_gone, laws.LINEARIZABLE, "c sees nothing in a list at "),
        (gone_after_written_anew, laws.READABLE, "c reads nothing at "),
        (other_is_gone, laws.READABLE, "c reads nothing at "),
        (deaf, laws.READABLE, "not everything can be read at the end: nobody answers"),
    ],
    ids=lambda value: value.__name__ if callable(value) else "",
)
def test_what_is_wrong_is_a_violation(spoil: Spoil, law: str, said: str) -> None:
    found = violations_after(spoil)
    assert [violation.law for violation in found] == [law], found
    assert said in found[0].what


def test_two_records_of_an_object_are_a_violation_on_the_disks_and_in_the_list() -> None:
    found = violations_after(managed_twice)
    assert {violation.law for violation in found} == {laws.ONE_RECORD}
    assert {violation.what.split()[0] for violation in found} == {"2", "c"}


class Histrionics:
    """As much of an observer as `judge_histories` asks for."""

    def __init__(self, *events: Any) -> None:
        self.histories = Histories()
        self.found: list[tuple[str, str]] = []
        for event in events:
            self.histories.add(Place(1, RENDERS, b"p" * 20), event)

    @property
    def recorder(self) -> Histrionics:
        return self

    def violated(self, law: str, what: str, *, location: bytes) -> None:
        assert location == b"p" * 20
        self.found.append((law, what))

    def judged(self) -> list[tuple[str, str]]:
        judge_histories(self)  # type: ignore[arg-type]
        return self.found


def version(number: int) -> Version:
    return Version((1, number, 1, 1, bytes([number])), bytes([number]) * 3)


def test_each_kind_of_event_is_told_in_words() -> None:
    stored = Write(1, 2, version(5), None, Outcome.DONE, "c0", 1.0)
    refused = Write(3, 4, version(6), None, Outcome.REFUSED, "c1", 2.0)
    assert Histrionics(stored, Listing(3, 4, True)).judged() == []
    ((law, what),) = Histrionics(stored, refused).judged()
    assert law == laws.LINEARIZABLE and "c1 is refused 060606 at 2.000 s, where 050505 must be" in what
    ((law, what),) = Histrionics(stored, Listing(3, 4, False, "c2", 3.0)).judged()
    assert law == laws.LINEARIZABLE and "c2 sees nothing in a list at 3.000 s, where 050505 must be" in what
    ((law, what),) = Histrionics(Write(1, 2, version(5), b"x", Outcome.DONE, "c0", 1.0)).judged()
    assert law == laws.LINEARIZABLE and "c0 is told that it stored 050505 at 1.000 s, where nothing must be" in what


def test_what_cannot_be_decided_is_not_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(final, "judge", lambda _events: Verdict(False, undecided=True))
    ((law, what),) = Histrionics(Listing(1, 2, False)).judged()
    assert law == laws.LINEARIZABLE and "too many orders to try them all (1 events)" in what
