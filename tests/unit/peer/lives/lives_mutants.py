"""One rule left out, or done wrongly, at a time. Each must be found: a soup that misses one is no soup."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from scenefold.peer.cluster_log import lease_grants, numbered_lives, telling_lives
from scenefold.peer.cluster_log.lease_asker import Round
from scenefold.peer.cluster_log.lease_grants import KnownLog
from scenefold.peer.cluster_log.numbered_lives import Life
from scenefold.peer.cluster_log.voter_rules import Council
from unit.peer.lives.lives_soup import Soup

Mutant = Callable[[pytest.MonkeyPatch, Soup], None]

rightly_answered, rightly_gathered = lease_grants.answer, telling_lives.gather


def lives_without_order(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    """As with one voter: who holds neither this life nor the one before it refuses."""
    patch.setattr(lease_grants, "takes", lambda held, asked: held is None or held == asked or held.number + 1 == asked.number)


def what_cannot_be_told_is_granted(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    """Likewise, but who holds neither grants."""
    patch.setattr(lease_grants, "takes", lambda held, asked: held is None or held == asked or held.number != asked.number)


def new_voters_know_nothing(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    def gather(gathering: Any, held: Any, log: Any, me: Any) -> Any:
        gathering, held = rightly_gathered(gathering, held, log, me)
        return gathering, replace(held, ready_at=gathering.council_at) if gathering.council_at else held

    patch.setattr(telling_lives, "gather", gather)


def the_first_of_two_lives(patch: pytest.MonkeyPatch, soup: object = None) -> None:
    def together(held: Life | None, told: Life) -> Life:
        return told if held is None or told.number > held.number else held

    patch.setattr(numbered_lives, "together", together)


def told_by_who_still_grants(patch: pytest.MonkeyPatch, councils: Callable[[], tuple[Council, ...]]) -> None:
    """Who has not heard of a change is told by who asks, and tells its lives at once. `councils`: all that there are by now."""

    def before(council_at: int, log: KnownLog) -> Council | None:
        known = councils()
        return next((earlier for earlier, later in pairwise(known) if later.position == council_at), None)

    patch.setattr(telling_lives, "_before", before)


def granted_with_something_accepted(patch: pytest.MonkeyPatch, soup: object = None) -> None:
    def answer(*args: Any, has_accepted: bool, **others: Any) -> Any:
        return rightly_answered(*args, has_accepted=False, **others)

    patch.setattr(lease_grants, "answer", answer)


def granted_to_who_does_not_know_the_voters(patch: pytest.MonkeyPatch, soup: object = None) -> None:
    patch.setattr(lease_grants, "_is_at", lambda have, log: have <= log.position)


def lives_are_not_durable(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    """Voters that crash often, so that it shows soon."""
    soup.world.forgets_lives = True
    soup.crashes = 12


def half_is_a_majority(patch: pytest.MonkeyPatch, soup: Soup) -> None:
    patch.setattr(Round, "is_granted", property(lambda asked: len(asked.granted) >= max(1, len(asked.voters.everyone) // 2)))


MUTANTS: dict[Mutant, int] = {
    lives_without_order: 30,
    what_cannot_be_told_is_granted: 30,
    new_voters_know_nothing: 60,
    lives_are_not_durable: 100,
    half_is_a_majority: 100,
}
"""Within how many seeds each must be found. The others, which take an unlikely order of steps, have plans (test_lives_plans.py)."""
