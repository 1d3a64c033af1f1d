"""If this fails, one peer's many requests leave no time for those of others, or a peer that is alone is held up."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from scenefold.world.shares import BUSY_SHARE, MEMBERS_SHARE, SAVED_S_MAX, Kind
from scenefold.world.turns import ACCUSED_S, BESIDE_S, TURN_S, TURNS_MAX, Guest, Turns

ME, OTHER, ANOTHER, PUSHY = (("user:me", 0), ("user:other", 0), ("user:another", 0), ("user:pushy", 0))


def begin_all(turns: Turns, guest: Guest, now: float, count: int) -> list[int]:
    """Begin as many of `count` requests as may."""
    found = []
    while len(found) < count and not turns.wait_s(guest, now):
        found.append(turns.begin(guest, now))
    return found


def visit(turns: Turns, guest: Guest, now: float) -> None:
    turns.end(guest, turns.begin(guest, now))


def test_who_is_alone_begins_all() -> None:
    assert len(begin_all(Turns(), ME, 0.0, 1_000)) == 1_000


def test_beside_others_a_few_and_the_next_when_one_ends() -> None:
    turns = Turns()
    visit(turns, OTHER, 0.0)
    mine = begin_all(turns, ME, 0.0, 100)
    assert len(mine) == TURNS_MAX
    turns.end(ME, mine[0])
    assert len(begin_all(turns, ME, 0.0, 100)) == 1
    assert len(begin_all(turns, ANOTHER, 0.0, 100)) == TURNS_MAX, "each has its own"


def test_what_was_begun_alone_counts_when_another_one_comes() -> None:
    turns = Turns()
    begin_all(turns, ME, 0.0, 100)
    turns.begin(OTHER, 0.001)
    assert 0 < turns.wait_s(ME, 0.002) <= TURN_S


def test_what_takes_long_counts_no_more() -> None:
    turns = Turns()
    visit(turns, OTHER, 0.0)
    begin_all(turns, ME, 0.0, 100)
    wait_s = turns.wait_s(ME, 0.01)
    assert 0 < wait_s <= TURN_S
    assert len(begin_all(turns, ME, 0.01 + wait_s, 100)) == TURNS_MAX


def test_others_that_have_gone_are_beside_nobody() -> None:
    turns = Turns()
    visit(turns, OTHER, 0.0)
    assert len(begin_all(turns, ME, 0.5 * BESIDE_S, 100)) == TURNS_MAX
    assert len(begin_all(turns, ME, 2 * BESIDE_S, 100)) == 100


def test_who_is_busy_at_one_port_is_beside_others_at_both_and_by_itself_at_none() -> None:
    turns = Turns()
    assert len(begin_all(turns, ("user:me", 1), 0.0, 100)) == len(begin_all(turns, ME, 0.0, 100)) == 100
    visit(turns, OTHER, 0.0)
    assert len(begin_all(turns, ("user:pushy", 1), 0.0, 100)) == len(begin_all(turns, PUSHY, 0.0, 100)) == TURNS_MAX


def test_who_is_alone_takes_all_the_time_and_beside_others_a_share() -> None:
    for other, most_s in ((False, 10.0), (True, SAVED_S_MAX + 0.6 * BUSY_SHARE)):
        turns, took_s = Turns(), 0.0
        for step in range(1_000):
            now = step / 1_000
            if other:
                visit(turns, OTHER, now)
                turns.pay(OTHER, 0.0003, now)
            while took_s < 10.0 and not turns.wait_s(ME, now):
                turns.pay(ME, 0.01, now)
                took_s += 0.01
        assert 0.9 * 0.5 * BUSY_SHARE <= took_s <= most_s + 0.01


def are_nodes_members(peer: str) -> bool:
    return peer.startswith("node:")


NODE, OTHER_NODE = ("node:1", 0), ("node:2", 0)


def took_by(turns: Turns, guest: Guest, seconds: float, beside: Guest | None, cost_s: float = 0.004) -> float:
    """What one takes of a thread that has so much time, beside another one that asks for little all the while."""
    now, took_s = 0.0, 0.0
    while now < seconds:
        if beside is not None:
            visit(turns, beside, now)
            turns.pay(beside, 0.001, now)
        now += 0.001
        if turns.wait_s(guest, now):
            continue
        number = turns.begin(guest, now)
        now += cost_s
        took_s += cost_s
        turns.pay(guest, cost_s, now)
        turns.end(guest, number)
    return took_s


def test_a_member_takes_all_the_time_while_no_client_asks_and_begins_no_more_at_a_time_than_others() -> None:
    for beside in (None, OTHER_NODE):
        assert took_by(Turns(are_nodes_members), NODE, 10.0, beside) >= 0.75 * 10.0, "as fast as they come"
    turns = Turns(are_nodes_members)
    visit(turns, OTHER_NODE, 0.0)
    turns.pay(NODE, 3.0, 0.0)
    assert len(begin_all(turns, NODE, 0.0, 100)) == TURNS_MAX


def test_beside_a_client_a_member_takes_its_part_and_no_more() -> None:
    taken_s = took_by(Turns(are_nodes_members), NODE, 10.0, OTHER)
    assert 0.9 * MEMBERS_SHARE <= taken_s / 10.0 <= 1.1 * MEMBERS_SHARE + (SAVED_S_MAX + 0.05) / 10.0


def test_a_client_that_has_gone_leaves_a_member_all() -> None:
    turns = Turns(are_nodes_members)
    visit(turns, OTHER, 0.0)
    turns.pay(NODE, 3.0, 0.0)
    assert turns.wait_s(NODE, BESIDE_S) > 0
    visit(turns, OTHER_NODE, BESIDE_S + 0.01)
    assert not turns.wait_s(NODE, BESIDE_S + 0.01)


def test_to_a_member_that_sends_what_is_forged_members_are_others_for_a_minute() -> None:
    turns = Turns(are_nodes_members)
    turns.accuse(NODE[0], 10.0)
    for guest, other in ((NODE, OTHER_NODE), (OTHER_NODE, NODE)):
        visit(turns, other, 10.0)
        turns.pay(guest, 0.2 + SAVED_S_MAX, 10.0)
    assert turns.wait_s(NODE, 10.0) > 0 and not turns.wait_s(OTHER_NODE, 10.0)
    kinds = [turns.kind_of(NODE[0], 10.0 + later) for later in (ACCUSED_S - 1.0, ACCUSED_S)]
    assert kinds == [Kind.ACCUSED, Kind.MEMBER]


def test_a_client_is_not_remembered_as_accused_and_a_member_not_for_ever() -> None:
    turns = Turns(are_nodes_members)
    for number in range(1_000):
        turns.accuse(f"user:{number}", 0.0)
        turns.accuse(f"node:{number}", number * 1.0)
    assert len(turns._accused) <= ACCUSED_S + 1


def test_who_was_quiet_for_long_is_forgotten() -> None:
    turns = Turns()
    for number in range(1_000):
        visit(turns, (f"user:{number}", 0), number * 0.1)
    assert len(turns._guests) <= BESIDE_S / 0.1 + 2


@given(
    st.lists(
        st.tuples(st.floats(0, 0.05), st.sampled_from([("a", 0), ("a", 1), ("b", 0)]), st.booleans(), st.floats(0, 0.001)), max_size=300
    )
)
def test_any_coming_and_going(steps: list[tuple[float, Guest, bool, float]]) -> None:
    turns, now = Turns(), 0.0
    begun: dict[Guest, dict[int, float]] = {("a", 0): {}, ("a", 1): {}, ("b", 0): {}}
    last: dict[Guest, float] = {}
    for pause, guest, ends, work_s in steps:
        now += pause
        mine = begun[guest]
        if ends and mine:
            number = next(iter(mine))
            del mine[number]
            turns.pay(guest, work_s, now)
            turns.end(guest, number)
            continue
        young = [at for at in mine.values() if at > now - TURN_S + 1e-9]
        beside = any(at > now - BESIDE_S + 1e-9 for other, at in last.items() if other[0] != guest[0])
        wait_s = turns.wait_s(guest, now)
        assert 0 <= wait_s <= TURN_S + 1e-9, "nobody has taken a tenth of a second"
        if not wait_s:
            assert not beside or len(young) < TURNS_MAX
            mine[turns.begin(guest, now)] = last[guest] = now
    for guest, mine in begun.items():
        for number in mine:
            turns.end(guest, number)
    assert not any(begun.at for begun in turns._guests.values())
