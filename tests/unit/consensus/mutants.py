"""The protocol with a hole in it: each way to be wrong that an argument of specs/25-consensus.md excludes, and that the soup must find."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import pytest

from scenefold.consensus import (
    Accepted,
    Fact,
    Message,
    Participants,
    Rejected,
    Slot,
    Stage,
    Value,
    Vote,
    acceptor,
    certificates,
    effort,
    facts,
    proposer_guards,
)
from scenefold.consensus.ballots import NO_BALLOT
from scenefold.consensus.choosing import Choice, choose
from scenefold.consensus.facts import belongs as rightly_belongs
from scenefold.wire import ProposalId
from unit.consensus.soup import Soup

Mutant = Callable[[pytest.MonkeyPatch, Soup], None]


def half_is_a_majority(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    patch.setattr(Participants, "majority", property(lambda known: max(1, len(known.everyone) // 2)))


def promises_are_not_durable(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    soup.world.forgets = lambda slot: replace(slot, promised=slot.accepted_ballot)


def votes_are_not_durable(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    soup.world.forgets = lambda slot: Slot(promised=slot.promised, exposed=slot.exposed)


def nothing_is_durable(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    soup.world.forgets = lambda slot: Slot()


def shown_before_it_is_durable(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    soup.world.shows_late = True


def highest_is_ignored(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    def wished(known: Sequence[Fact], values: Iterable[Value], wish: Value | None, participants: Participants) -> Choice | None:
        choice = choose(known, values, wish, participants)
        return choice if choice is None or wish is None else Choice(wish)

    patch.setattr(effort, "choose", wished)


def ballots_are_counted_together(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    """Votes for a value, of whatever ballot. Everybody hears of all that were ever cast, which is no mistake in itself."""
    world = soup.world

    def belongs(fact: Fact, proposal: ProposalId, digest: bytes) -> bool:
        is_vote_for_it = isinstance(fact, Vote) and (fact.position, fact.digest) == (proposal.position, digest)
        return is_vote_for_it or rightly_belongs(fact, proposal, digest)

    patch.setattr(facts, "belongs", belongs)
    patch.setattr(certificates, "belongs", belongs)
    deliver, cast = world.deliver, dict[tuple[int, bytes], set[Vote]]()

    def with_hearsay(source: int, target: int, message: Message) -> None:
        if isinstance(message, Accepted | Rejected):
            known = cast.setdefault((message.proposal.position, message.digest), set())
            known |= {fact for fact in message.facts if isinstance(fact, Vote)}
            message = replace(message, facts=(*message.facts, *sorted(known, key=lambda vote: (vote.ballot, vote.member.node))))
        deliver(source, target, message)

    world.deliver = with_hearsay  # type: ignore[method-assign]


def opened_before_it_is_decided(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    soup.world.opens_early = True


def the_wiped_vote(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    soup.same_incarnation = True


def anybody_is_first(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    """Two nodes have a first ballot each, the higher of which needs promises."""

    def is_first(step: effort.Effort) -> bool:
        ask, slot = step.asked, step.case.slot
        return ask is not None and ask.value is not None and slot.promised == NO_BALLOT and slot.accepted is None

    patch.setitem(proposer_guards.GUARDS, "has_the_first_ballot", is_first)
    patch.setitem(acceptor.GUARDS, "not_first", lambda guest: False)


def a_promise_does_not_end_the_first_ballot(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    """The first votes in it, though it has taken part in higher ones."""

    def is_first(step: effort.Effort) -> bool:
        ask = step.asked
        return ask is not None and ask.value is not None and step.case.participants.first == step.case.me

    patch.setitem(proposer_guards.GUARDS, "has_the_first_ballot", is_first)


def the_first_ballot_is_used_twice(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    """Who has voted in it, and was told that nobody knows, votes in it for something else."""

    def is_first(step: effort.Effort) -> bool:
        ask, case = step.asked, step.case
        is_new = ask is not None and ask.value is not None
        return is_new and case.participants.first == case.me and case.slot.promised.counter == 0

    patch.setitem(proposer_guards.GUARDS, "has_the_first_ballot", is_first)
    soup.hasty = 1.0


def the_first_forgets_its_vote(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    """After a start it votes in its first ballot again, for something else."""
    soup.hasty = 1.0
    soup.world.forgets = lambda slot: Slot() if slot.promised.counter == 0 else slot
    soup.world.laws.watches_disks = False


def late_promises_count_for_ever(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    """Of those that come while it pauses, whatever this node has promised since."""

    def overtaken(step: effort.Effort) -> bool:
        return step.proposal.stage is not Stage.RESTING and proposer_guards.overtaken(step)

    patch.setitem(proposer_guards.GUARDS, "overtaken", overtaken)


MUTANTS: dict[Mutant, int] = {
    half_is_a_majority: 20,
    promises_are_not_durable: 20,
    votes_are_not_durable: 60,
    nothing_is_durable: 20,
    shown_before_it_is_durable: 20,
    highest_is_ignored: 60,
    ballots_are_counted_together: 100,
    opened_before_it_is_decided: 300,
    the_wiped_vote: 60,
    anybody_is_first: 60,
    a_promise_does_not_end_the_first_ballot: 60,
    the_first_ballot_is_used_twice: 60,
    the_first_forgets_its_vote: 60,
    late_promises_count_for_ever: 100,
}
"""Within how many seeds each must be found. It was after 1, 1, 3, 1, 3, 36, 12, 64, 8, 4, 2, 8, 31 and 2 of them."""
