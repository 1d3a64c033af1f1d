"""If this fails, a pass counts twice in an image, or not at all, when nodes die (specs/31-attempts.md)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.render.film import Film
from scenefold.render.job import Job
from scenefold.render.levels import Adaptive
from scenefold.render.pass_sums import PassSums
from scenefold.render.pool.company import Apart, Company, NodesLost, lost_of, who_go
from scenefold.render.pool.films import Films
from scenefold.render.pool.pass_bits import bits_of, passes_of
from scenefold.render.pool.roster import Roster
from unit.render.test_job import JOB

NODES = tuple(NodeId(0x7F000002 + index) for index in range(5))
SMALL = replace(JOB, nodes=NODES, width=5, height=1, crop=None, layers=(), adaptive=None)
PATHS = 5
PASSES = 9
STRIDE = Film(5, 1)._stride


def paths_of(_number: int) -> int:
    return PATHS


def sums_of(number: int) -> PassSums:
    """A pass is traced anew in each attempt, and has the same sums."""
    made = PassSums.zeros(PATHS, SMALL.columns)
    made.radiance[:] = np.random.default_rng(number).integers(0, 2**40, made.radiance.shape)
    return made


def film_of(passes: Iterable[int]) -> bytes:
    film = Film(5, 1, SMALL.columns)
    for number in passes:
        film.add(sums_of(number), number * PATHS, STRIDE)
    return b"".join(film.parts())


def add(films: Films, number: int, *, of: NodeId | None = None) -> None:
    summed = films.own if of is None else films.copy_of(of)
    summed.add(number, sums_of(number), number * PATHS, STRIDE, np.zeros(0, np.uint8))


@dataclass
class Pool:
    """The organiser and all nodes, as far as films go."""

    data: st.DataObject
    job: Job
    roster: Roster
    films: dict[NodeId, Films]
    done: frozenset[int] = frozenset()
    gatherings: int = 0
    gathered: int = 0

    @property
    def organiser(self) -> Films:
        return self.films[self.roster.organiser]

    def owner(self, number: int) -> int:
        return number % len(self.roster.nodes)

    def work(self) -> None:
        """Some passes are closed, some of these copied."""
        for number in self.data.draw(st.lists(st.integers(0, PASSES - 1), max_size=PASSES)):
            self.close(number, is_copied=self.data.draw(st.booleans()))

    def close(self, number: int, *, is_copied: bool) -> None:
        place = self.owner(number)
        node, keeper = self.roster.nodes[place], self.roster.keeper(place)
        if number in self.done:
            return
        add(self.films[node], number)
        if is_copied and keeper is not None:
            add(self.films[self.roster.nodes[keeper]], number, of=node)

    def gather(self) -> bool:
        """Along the line; False if somebody died on the way, so that it stops anywhere."""
        self.gatherings += 1
        passes: set[int] = set()
        place = self.roster.nodes.index(self.roster.organiser)
        for side in (self.roster.nodes[:place], self.roster.nodes[:place:-1]):
            for node, towards in pairwise((*side, self.roster.organiser)):
                films = self.films[node]
                films.begin(self.gatherings)
                if self.data.draw(st.integers(0, 9)) == 0:
                    return False
                self.films[towards].begin(self.gatherings)
                for index in range(films.part_count):
                    self.films[towards].merge_part(self.gatherings, node, index, films.part(index))
                self.films[towards].check_came(self.gatherings, node)
                passes |= films.own.passes
        self.organiser.begin(self.gatherings)
        self.organiser.check_samples(passes, paths_of)
        self.organiser.take_gathered(passes)
        self.gathered = self.gatherings
        for node in self.roster.nodes:
            if node != self.roster.organiser:
                if self.data.draw(st.integers(0, 9)) == 0:
                    return False
                self.films[node].forget_gathered(self.gathered)
        return True

    def begin_again(self) -> None:
        """Others die, and some come back, until an attempt begins; or nobody is left that may."""
        while len(self.roster.nodes) > 1:
            others = [node for node in self.roster.nodes if node != self.roster.organiser]
            if self.change(self.data.draw(st.sets(st.sampled_from(others), min_size=1)), set()):
                return

    def come_back(self) -> None:
        """Some that died take part again, with nothing in their films."""
        missing = [node for node in NODES if node not in self.roster.nodes]
        back = self.data.draw(st.sets(st.sampled_from(missing), min_size=1))
        self.films |= {node: Films(SMALL) for node in back}
        if not self.change(set(), back):
            self.begin_again()

    def change(self, lost: set[NodeId], back: set[NodeId]) -> bool:
        """Whether the next attempt began."""
        self.roster = self.roster.changed(self.job, lost, back)
        for node in self.roster.nodes:
            self.films[node].forget_gathered(self.gathered)
            self.films[node].adopt(self.roster.nodes)
        sets = [self.films[node].own.passes for node in self.roster.nodes]
        union = frozenset().union(*sets)
        assert len(union) == sum(map(len, sets)), "a pass is in two films"
        for node in self.roster.nodes:
            own = self.films[node].own
            assert b"".join(own.film.parts()) == film_of(own.passes), "a film is that of its set"
        if not self.gather():
            return False
        self.done = union
        return True


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_each_pass_counts_once_whoever_dies_when(data: st.DataObject) -> None:
    organiser = data.draw(st.sampled_from(NODES))
    pool = Pool(data, SMALL, Roster.first(SMALL, organiser), {node: Films(SMALL) for node in NODES})
    while len(pool.roster.nodes) > 1 and data.draw(st.booleans()):
        pool.work()
        if len(pool.roster.nodes) < len(NODES) and data.draw(st.booleans()):
            pool.come_back()
        else:
            pool.begin_again()
    for number in range(PASSES):
        pool.close(number, is_copied=True)
    while not pool.gather():
        pool.begin_again()
        for number in range(PASSES):
            pool.close(number, is_copied=True)
    assert pool.organiser.own.passes == set(range(PASSES))
    assert b"".join(pool.organiser.own.film.parts()) == film_of(range(PASSES))


def test_what_was_copied_is_not_traced_again() -> None:
    films = {node: Films(SMALL) for node in NODES}
    roster = Roster.first(SMALL, NODES[0])
    dead = 2
    keeper = roster.keeper(dead)
    assert keeper == 3
    for number in (4, 7):
        add(films[NODES[dead]], number)
    for number in (4, 7, 4):
        add(films[NODES[3]], number, of=NODES[dead])
    after = roster.changed(SMALL, [NODES[dead]], [])
    films[NODES[3]].adopt(after.nodes)
    assert films[NODES[3]].own.passes == {4, 7}
    assert b"".join(films[NODES[3]].own.film.parts()) == film_of([4, 7])
    films[NODES[3]].adopt(after.nodes)
    assert films[NODES[3]].own.passes == {4, 7}


def test_films_of_an_older_gathering_are_refused() -> None:
    films = Films(SMALL)
    films.begin(3)
    with pytest.raises(Refused):
        films.begin(2)
    with pytest.raises(Refused):
        films.merge_part(2, NODES[1], 0, film_of([1]))
    films.merge_part(3, NODES[1], 0, film_of([1]))
    films.begin(4)
    assert films.part(0) == film_of([]), "of a gathering that failed nothing is left"
    films.forget_gathered(4)
    with pytest.raises(Refused):
        films.merge_part(4, NODES[1], 0, film_of([1]))


def test_a_film_comes_once_and_as_a_whole() -> None:
    films, sender = Films(SMALL), NODES[1]
    films.begin(1)
    with pytest.raises(PeerFault, match="0 of 1 parts of a film came"):
        films.check_came(1, sender)
    films.merge_part(1, sender, 0, film_of([1]))
    films.check_came(1, sender)
    with pytest.raises(PeerFault, match="came twice") as caught:
        films.merge_part(1, sender, 0, film_of([1]))
    assert address_of(sender) in caught.value.where
    films.merge_part(1, NODES[3], 0, film_of([2]))
    films.check_samples([1, 2], paths_of)
    films.begin(2)
    films.merge_part(2, sender, 0, film_of([1]))
    films.check_came(2, sender)


def test_films_have_the_samples_of_their_passes() -> None:
    """Our own count neither for nor against them."""
    films = Films(SMALL)
    add(films, 4)
    films.begin(1)
    films.check_samples([4], paths_of)
    films.merge_part(1, NODES[1], 0, film_of([1, 2]))
    films.check_samples([1, 2, 4], paths_of)
    for passes in ([1], [1, 2, 3], []):
        with pytest.raises(PeerFault, match="samples, and their passes have"):
            films.check_samples(passes, paths_of)
    adaptive = Films(replace(SMALL, adaptive=Adaptive(0.1, 1)))
    adaptive.begin(1)
    adaptive.merge_part(1, NODES[1], 0, film_of([1, 2]))
    adaptive.check_samples([1, 2, 3], paths_of)
    with pytest.raises(PeerFault, match="samples"):
        adaptive.check_samples([1], paths_of)


def test_a_film_is_forgotten_once_for_a_gathering() -> None:
    films = Films(SMALL)
    add(films, 1)
    films.forget_gathered(2)
    add(films, 3)
    films.forget_gathered(2)
    films.forget_gathered(1)
    assert films.own.passes == {3} and films.part(0) == film_of([3])


def test_films_with_the_same_pass_are_not_added() -> None:
    films = Films(SMALL)
    add(films, 1)
    add(films, 1, of=NODES[1])
    with pytest.raises(PeerFault, match="twice"):
        films.adopt(NODES[:1])


@given(st.integers(1, 90), st.data())
def test_sets_of_passes_round_trip(count: int, data: st.DataObject) -> None:
    passes = data.draw(st.frozensets(st.integers(0, count - 1)))
    assert passes_of(bits_of(passes, count), count) == passes


@pytest.mark.parametrize(("bits", "count"), [(b"", 1), (b"\0\0", 8), ("a", 8), (None, 8), (b"\x02", 1), (b"\xff\x10", 12)])
def test_what_is_no_set_of_passes_is_refused(bits: object, count: int) -> None:
    with pytest.raises(PeerFault):
        passes_of(bits, count)


def test_a_roster_round_trips() -> None:
    roster = Roster.first(SMALL, NODES[1]).changed(SMALL, [NODES[3], NODES[2]], []).changed(SMALL, [NODES[0]], [NODES[2]])
    assert roster == Roster(2, (NODES[1], NODES[2], NODES[4]), NODES[1])
    assert Roster.from_document(roster.document(), SMALL, NODES[1], NODES[4]) == roster
    assert [roster.place(node) for node in NODES] == [None, 0, 1, None, 2]
    assert [roster.keeper(place) for place in range(3)] == [None, 2, 0]
    assert Roster(1, NODES[:1], NODES[0]).keeper(0) is None


@pytest.mark.parametrize(
    "document",
    [
        {"hold": 1},
        {"hold": 0, "nodes": list(map(int, NODES))},
        {"hold": "1", "nodes": list(map(int, NODES))},
        {"hold": 1, "nodes": [int(NODES[1]), int(NODES[0]), int(NODES[4])]},
        {"hold": 1, "nodes": [int(NODES[1]), int(NODES[1]), int(NODES[4])]},
        {"hold": 1, "nodes": [int(NODES[1]), int(NODES[2])]},
        {"hold": 1, "nodes": [int(NODES[2]), int(NODES[4])]},
        {"hold": 1, "nodes": [int(NODES[1]), int(NODES[4]), 5]},
        {"hold": 1, "nodes": 7},
    ],
)
def test_what_is_no_roster_is_refused(document: dict[str, object]) -> None:
    with pytest.raises(PeerFault):
        Roster.from_document(document, SMALL, NODES[1], NODES[4])


def test_what_fails_because_a_node_is_lost_is_no_other_failure() -> None:
    lost = NodesLost([NODES[1]], Unreachable("away"))
    other = NodesLost([NODES[2]], Unreachable("away, too"))
    found = lost_of(ExceptionGroup("", [Unreachable("away"), ExceptionGroup("", [lost, other])]))
    assert found is not None and found.nodes == {NODES[1], NODES[2]}
    assert lost_of(ExceptionGroup("", [lost, PeerFault("of another kind")])) is None
    assert lost_of(Unreachable("nobody says that a node is lost")) is None


def test_of_two_that_do_not_reach_each_other_one_goes_and_of_many_the_one_in_their_middle() -> None:
    a, b, c, d, organiser = NODES
    assert set(who_go([Apart(a, b, "1"), Apart(b, a, "2")], organiser)) == {b}
    assert set(who_go([Apart(organiser, a, "1"), Apart(a, organiser, "2")], organiser)) == {a}
    alone = [Apart(a, other, "no") for other in (b, c, d)] + [Apart(other, a, "no") for other in (b, c, d)]
    assert set(who_go(alone, organiser)) == {a}
    assert set(who_go([Apart(a, b, "1"), Apart(c, d, "2")], organiser)) == {b, d}
    assert who_go([], organiser) == {}


@given(st.lists(st.tuples(st.sampled_from(NODES), st.sampled_from(NODES))))
def test_those_that_stay_reach_each_other(pairs: list[tuple[NodeId, NodeId]]) -> None:
    organiser = NODES[0]
    away = [Apart(by, other, f"{by} {other}") for by, other in pairs]
    gone = who_go(away, organiser)
    assert organiser not in gone
    assert all(by == other or by in gone or other in gone for by, other in pairs)
    assert all(node in (apart.by, apart.other) for node, apart in gone.items())


def test_a_film_takes_no_memory_before_it_is_wanted() -> None:
    """As a node finds out whether it may hold it once its part is there: 16,384 x 16,384 pixels are some 36 GB."""
    films = Films(replace(SMALL, width=16384, height=16384))
    films.forget_gathered(1)
    assert "film" not in vars(films.own)


def test_what_a_node_did_before_it_was_lost_and_came_back_is_told_with_what_it_does_since() -> None:
    company = Company(cast(Any, SimpleNamespace(node_id=NODES[0])), SMALL)
    one, other = NODES[:2]
    company.states = {one: {"casts": 5, "busy_seconds": 1.5, "triangles": 9}, other: {"casts": 7, "triangles": 2}}
    assert company.whole_states() == company.states
    for casts in (7, 30):
        company.states[other] = {"casts": casts}
        company.is_back(other)
    assert company.whole_states()[other]["casts"] == 37, "and before it has told anything anew"
    company.states[other] = {"casts": 3, "busy_seconds": 0.5, "triangles": 4, "phase": "running"}
    told = company.whole_states()
    assert (told[other]["casts"], told[other]["busy_seconds"], told[other]["triangles"], told[other]["phase"]) == (40, 0.5, 4, "running")
    assert told[one] == company.states[one] and company.states_of([other])[other]["casts"] == 3
