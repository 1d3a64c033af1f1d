"""What must happen in an order that chance seldom hits: plans by which a rule that is left out lets an old lease meet a new mode.

With all rules in force none of them breaks anything; `Broken` shows that a rule is not in force.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from scenefold.wire import Ballot, Member
from unit.peer.modes.village import Clock, Value, Village

SWITCH = Value(1_000_001, switches=True)
OTHER = Value(1_000_002)


def village(nodes: int, observers: int = 0, clients: int = 0) -> tuple[Village, list[Member]]:
    """One that has been running for a while; all clocks run right."""
    made = Village(1, nodes, observers, clients)
    for node in made.nodes.values():
        node.clock = Clock(1.0, node.clock.offset)
    made.let_pass(20.0)
    return made, list(made.nodes)


def lease(made: Village, member: Member) -> bool:
    """Ask for one, and be answered at once."""
    asked = made.ask(member)
    deliver(made)
    return asked


def deliver(made: Village) -> None:
    while made.mail:
        made.mail.pop(0)()


def open_ballot(made: Village, counter: int, promising: list[Member], wish: Value) -> Ballot:
    ballot = Ballot(counter, promising[0].node)
    assert made.open_ballot(max(made.positions), promising, ballot, wish)
    return ballot


def vote(made: Village, ballot: Ballot, members: Iterable[Member]) -> list[bool]:
    return [made.vote(member, ballot) for member in members]


def settle(made: Village, members: list[Member]) -> None:
    """They learn what is decided, tell each other all that they may, and time goes on."""
    for member in members:
        made.learn(member)
    for _ in range(2):
        for member in members:
            made.show_votes(member, all_of_them=True)
            made.release(member)
            made.hear(member, all_of_them=True)
    made.let_pass(13.0)


def an_early_vote() -> Village:
    """A votes for the switch alone, then for another value. Then it asks, and C, D, E, who have accepted nothing, grant. These vote for the
    switch in a third ballot; B learns, and releases. The only vote of A for it is of an early ballot."""
    made, (a, b, c, d, e) = village(5)
    vote(made, open_ballot(made, 1, [a, b, c], SWITCH), [a])
    vote(made, open_ballot(made, 2, [b, c, d], OTHER), [b, a])
    lease(made, a)
    vote(made, open_ballot(made, 3, [c, d, e], SWITCH), [c, d, e])
    settle(made, [b, c, d, e])
    return made


def clocks_of_a_client_and_its_lender() -> Village:
    """The lender's runs fast, the client's slow; the lender votes as soon as it believes that nothing is lent any more."""
    made, (a,) = village(1, clients=1)
    made.nodes[a].clock, made.clients[0].clock = replace(made.nodes[a].clock, rate=1.01), Clock(0.99, 0.0)
    lease(made, a)
    made.borrow(0, a)
    deliver(made)
    made.let_pass(12.0)
    vote(made, open_ballot(made, 1, [a], SWITCH), [a])
    settle(made, [a])
    return made


def clocks_of_a_holder_and_who_waits() -> Village:
    """Whoever learns of the switch has a fast clock; A, who is cut off, a slow one."""
    made, (a, b, c) = village(3)
    made.nodes[a].clock, made.nodes[b].clock = replace(made.nodes[a].clock, rate=0.99), replace(made.nodes[b].clock, rate=1.01)
    lease(made, a)
    vote(made, open_ballot(made, 1, [b, c], SWITCH), [b, c])
    settle(made, [b, c])
    return made


def an_observer_that_crashes() -> Village:
    """It releases, starts anew, and asks before anybody but A has voted."""
    made, (a, b, c, observer) = village(3, observers=1)
    ballot = open_ballot(made, 1, [a, b], SWITCH)
    vote(made, ballot, [a])
    made.show_votes(observer, all_of_them=True)
    made.crash(observer)
    made.start(observer)
    lease(made, observer)
    vote(made, ballot, [b, c])
    settle(made, [a, b, c])
    return made


def an_observer_that_asks_again() -> Village:
    """It releases, and asks before anybody but A has voted."""
    made, (a, b, c, observer) = village(3, observers=1)
    ballot = open_ballot(made, 1, [a, b], SWITCH)
    vote(made, ballot, [a])
    made.show_votes(observer, all_of_them=True)
    lease(made, observer)
    vote(made, ballot, [b, c])
    settle(made, [a, b, c])
    return made


def a_voter_that_asks_again() -> Village:
    """A votes for the switch, and asks before anybody else has voted."""
    made, (a, b, c) = village(3)
    ballot = open_ballot(made, 1, [a, b], SWITCH)
    vote(made, ballot, [a])
    lease(made, a)
    vote(made, ballot, [b, c])
    settle(made, [b, c])
    return made


def a_lender_that_crashes() -> Village:
    """A lends to a client, starts anew, and is asked for its vote."""
    made, (a, b, c) = village(3, clients=1)
    lease(made, a)
    made.borrow(0, a)
    deliver(made)
    made.crash(a)
    made.start(a)
    vote(made, open_ballot(made, 1, [b, c], SWITCH), [a, b, c])
    settle(made, [b, c])
    return made


def a_release_and_a_start() -> Village:
    """An observer holds a lease, releases, and starts anew."""
    made, (a, b, c, observer) = village(3, observers=1)
    lease(made, observer)
    vote(made, open_ballot(made, 1, [b, c], SWITCH), [a, b, c])
    made.show_votes(observer, all_of_them=True)
    made.crash(observer)
    made.start(observer)
    settle(made, [a, b, c])
    return made


def who_was_removed() -> Village:
    """A holds a lease, and is removed; those who are left vote for the switch, all of them."""
    made, (a, b, c) = village(3)
    lease(made, a)
    vote(made, open_ballot(made, 1, [b, c], Value(1, leaves=a)), [b, c])
    for member in (b, c):
        made.learn(member)
    vote(made, open_ballot(made, 1, [b, c], SWITCH), [b, c])
    settle(made, [b, c])
    return made


def a_removal_that_not_all_have_learnt() -> Village:
    """B has known for long that C is removed; A, who voted for that, has not learnt it when C asks. Then A and B vote for the switch."""
    made, (a, b, c) = village(3)
    vote(made, open_ballot(made, 1, [a, b], Value(1, leaves=c)), [a, b])
    made.learn(b)
    made.let_pass(13.0)
    lease(made, c)
    made.learn(a)
    vote(made, open_ballot(made, 1, [a, b], SWITCH), [a, b])
    settle(made, [b])
    return made


def an_observer_whose_removal_not_all_have_learnt() -> Village:
    """Likewise of an observer, which A and C are asked by; then all three vote for the switch."""
    made, (a, b, c, observer) = village(3, observers=1)
    vote(made, open_ballot(made, 1, [a, b], Value(1, leaves=observer)), [a, b])
    made.learn(b)
    made.let_pass(13.0)
    lease(made, observer)
    for member in (a, c):
        made.learn(member)
    vote(made, open_ballot(made, 1, [a, b], SWITCH), [a, b, c])
    settle(made, [b])
    return made


def more_who_decide() -> Village:
    """Two come to decide, and with B they switch. C has learnt of them, and not of the switch; A has learnt nothing, and asks at last."""
    made, (a, b, c, d, e) = village(3, observers=2)
    for number, joining, voting in ((1, d, [b, c]), (2, e, [b, c, d])):
        vote(made, open_ballot(made, 1, voting, Value(number, joins=joining)), voting)
        for member in (b, c, d, e):
            made.learn(member)
    vote(made, open_ballot(made, 1, [b, d, e], SWITCH), [b, d, e])
    settle(made, [b, d, e])
    lease(made, a)
    made.let_pass(0.1)
    return made


PLANS = (
    an_early_vote,
    clocks_of_a_client_and_its_lender,
    clocks_of_a_holder_and_who_waits,
    an_observer_that_crashes,
    an_observer_that_asks_again,
    a_voter_that_asks_again,
    a_lender_that_crashes,
    a_release_and_a_start,
    who_was_removed,
    a_removal_that_not_all_have_learnt,
    an_observer_whose_removal_not_all_have_learnt,
    more_who_decide,
)
