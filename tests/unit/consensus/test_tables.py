"""If this fails, a row of a table is never taken, so that nobody has tried what it says, or an event finds no row."""

from __future__ import annotations

import pytest

from scenefold.consensus import Outcome, acceptor, hops, learning, proposer
from scenefold.consensus.acceptor_table import ACCEPT, ACCEPTOR, PREPARE
from scenefold.consensus.hops_table import HOME, HOP_OVER, HOPS
from scenefold.consensus.learning_table import LEARN, LEARNING, LOG_ASKED
from scenefold.consensus.proposer_table import ASK, ORPHANED, PROPOSER
from scenefold.consensus.state import Stage
from scenefold.consensus.tables import Row, first_fit
from unit.consensus.soup import Soup
from unit.consensus.world import Weather, World

SEEDS = 40
TABLES = {"acceptor": ACCEPTOR, "hops": HOPS, "learning": LEARNING, "proposer": PROPOSER}
ELSEWHERE = {
    # What only forged packets lead to: test_bad_packets.py.
    "of_another_log",
    "without_a_value",
    "not_first",
    "not_of_its_originator",
    "route_incomplete",
    "has_voted_otherwise_in_it",
    "unproven",
    "not_of_a_participant",
    # What bodies bring: test_bodies.py.
    "without_its_body",
    # What nobody does by himself: test_bad_packets.py.
    "my_own",
    "of_a_stranger",
    "ill_formed",
    # What modes bring, and test_answers.py tries.
    "abstains",
    "does_not_suit",
    "not_all_agree",
    # After four thousand million ballots.
    "no_ballot_left",
    # Needs a plan, or long: test_answers.py.
    "under_way",
    "nobody_waits",
    "for_good",
    "found",
}


@pytest.fixture(scope="module")
def taken() -> set[Row]:
    """The rows that some seeds of the soup take."""
    rows: set[Row] = set()

    def noted(*arguments: object) -> Row | None:
        row = first_fit(*arguments)  # type: ignore[arg-type]
        if row is not None:
            rows.add(row)
        return row

    with pytest.MonkeyPatch.context() as patch:
        for module in (acceptor, hops, learning, proposer):
            patch.setattr(module, "first_fit", noted)
        for seed in range(SEEDS):
            Soup(seed).run()
        _full_behind_its_promise()
        _slow()
    return rows


def _full_behind_its_promise() -> None:
    """What few seeds meet: a majority promises, and then the own disk takes no vote."""
    world = World(1, 1, 2, 3)
    world.ask(1, "it")
    world.nodes[1].disk.is_full = True
    world.run(1.0)
    world.nodes[1].disk.is_full = False
    world.run(30.0)
    assert world.agree() == ["it"]


def _slow() -> None:
    """Promises come in the pause: to one that only looks, and to one whose disk then takes no vote."""
    for seed in range(4):
        looks = World(seed, 2, 1, 3, weather=Weather(delay_s=(3.7, 3.7)))
        looks.ask_again(1, None, within=60.0)
        looks.run(60.0)
        assert [reply.outcome for reply in looks.nodes[1].replies] == [Outcome.OPEN]
    asks = World(1, 2, 1, 3, weather=Weather(delay_s=(4.0, 4.0)))
    asks.ask(1, "it", within=60.0)
    asks.run(4.0, lambda: _is_resting(asks, 1))
    asks.nodes[1].disk.is_full = True
    asks.run(10.0)
    asks.nodes[1].disk.is_full = False
    asks.run(60.0)
    assert asks.agree() == ["it"]


def _is_resting(world: World, node: int) -> bool:
    state = world.nodes[node].state
    return state is not None and state.proposal.stage is Stage.RESTING


@pytest.mark.parametrize("name", TABLES)
def test_every_row_is_taken(name: str, taken: set[Row]) -> None:
    missing = [row for row in TABLES[name] if row not in taken and not ELSEWHERE & set(row.given)]
    assert missing == []


@pytest.mark.parametrize(
    ("rows", "events"),
    [(ACCEPTOR, (PREPARE, ACCEPT)), (HOPS, (HOME, HOP_OVER)), (LEARNING, (LEARN, LOG_ASKED))],
    ids=["acceptor", "hops", "learning"],
)
def test_the_last_row_of_an_event_has_no_guards(rows: tuple[Row, ...], events: tuple[str, ...]) -> None:
    assert {event for row in rows for event in row.on} == set(events)
    for event in events:
        assert [row for row in rows if event in row.on][-1].given == ()


@pytest.mark.parametrize("stage", Stage)
def test_a_stage_has_an_answer_to_whoever_asks_and_to_orphans(stage: Stage) -> None:
    for event in (ASK, ORPHANED):
        assert [row for row in PROPOSER if event in row.on and stage in row.at][-1].given == ()


@pytest.mark.parametrize("name", TABLES)
def test_no_row_hides_another(name: str) -> None:
    """One that asks for less, in the same case, stands below."""
    rows = TABLES[name]
    for number, row in enumerate(rows):
        for above in rows[:number]:
            covers = set(row.on) <= set(above.on) and set(row.at) <= set(above.at) and set(above.given) <= set(row.given)
            assert not covers, f"{above} is always taken before {row}"
