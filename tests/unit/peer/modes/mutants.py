"""Leases with a rule left out: each that the argument of specs/26-modes.md needs, and that the soup must miss."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from scenefold.peer.modes import Standing, Verdict, activation, lender, standing, verdict
from scenefold.peer.modes.activation import Activation, Switch
from scenefold.peer.modes.releases import Releases
from scenefold.peer.modes.scene import DecidedScene
from scenefold.wire import Member, Vote
from unit.peer.modes import plans
from unit.peer.modes.village import Village

Mutant = Callable[[pytest.MonkeyPatch], None]


def no_wait(patch: pytest.MonkeyPatch) -> None:
    """Who learns of a switch acts by it."""
    patch.setattr(activation, "T_WAIT_S", 0.0)


def a_wait_no_longer_than_a_lease(patch: pytest.MonkeyPatch) -> None:
    """As if all clocks ran alike."""
    patch.setattr(activation, "T_WAIT_S", 12.0)


def granted_with_an_open_vote(patch: pytest.MonkeyPatch) -> None:
    def lax(scene: DecidedScene, me: Member, asker: Member, have: int, *, steady_since: int, ends_leases: bool) -> Verdict:
        return verdict(scene, me, asker, have, steady_since=steady_since, ends_leases=False)

    patch.setattr(standing, "verdict", lax)


def granted_whatever_was_decided_since(patch: pytest.MonkeyPatch) -> None:
    def lax(scene: DecidedScene, me: Member, asker: Member, have: int, *, steady_since: int, ends_leases: bool) -> Verdict:
        return verdict(scene, me, asker, have, steady_since=0, ends_leases=ends_leases)

    patch.setattr(standing, "verdict", lax)


def granted_with_an_open_removal(patch: pytest.MonkeyPatch) -> None:
    """Only a vote for a SetMode counts."""
    patch.setattr(DecidedScene, "ends_leases_with", DecidedScene.is_switched_by)


def granted_with_an_open_removal_of_an_observer(patch: pytest.MonkeyPatch) -> None:
    """Only what changes those who decide counts, or the mode."""

    def ends(known: DecidedScene, after: DecidedScene) -> bool:
        return known.is_switched_by(after) or known.participants != after.participants

    patch.setattr(DecidedScene, "ends_leases_with", ends)


def granted_although_others_decide(patch: pytest.MonkeyPatch) -> None:
    """Only a SetMode counts of what was decided since."""
    decided = Standing.decided

    def lax(known: Standing, after: DecidedScene, *more: Any) -> Standing:
        standing = decided(known, after, *more)
        return standing if known.scene.is_switched_by(after) else replace(standing, steady_since=known.steady_since)

    patch.setattr(Standing, "decided", lax)


def votes_of_several_ballots_count(patch: pytest.MonkeyPatch) -> None:
    """A vote for it is one, whatever its voter voted for since."""

    def is_for_it(switch: Switch, vote: Vote) -> bool:
        return (vote.position, vote.digest) == (switch.position, switch.digest) and vote.member in switch.participants

    patch.setattr(Switch, "is_for_good", is_for_it)


def what_is_lent_is_forgotten_at_the_vote(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Standing, "abstains", lambda known, *, is_switch, now: False)


def lent_for_no_longer_than_it_seems(patch: pytest.MonkeyPatch) -> None:
    """The lender's clock runs fast, the client's slow."""
    patch.setattr(lender, "LENT_FACTOR", 1.0)


def a_lease_survives_a_start(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Village, "keeps_leases", True)


def what_is_lent_is_forgotten_at_a_start(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Village, "forgets_lent", True)


def removals_are_forgotten(patch: pytest.MonkeyPatch) -> None:
    """The shortcut is taken though somebody was removed a moment ago, who is asked by nobody."""
    patch.setattr(Activation, "removed", lambda known, releases, now: known)
    started = Activation.started
    patch.setattr(
        Activation, "started", lambda now, *, was_switched: replace(started(now, was_switched=was_switched), removed_at=-math.inf)
    )


def observers_are_not_asked(patch: pytest.MonkeyPatch) -> None:
    switched = Activation.switched
    patch.setattr(Activation, "switched", lambda known, switch, now: switched(known, replace(switch, observers=frozenset()), now))


def releases_are_not_durable(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Village, "forgets_releases", True)


def released_and_asked_for_all_the_same(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Releases, "allow", lambda known, position: True)


def a_vote_keeps_the_own_lease(patch: pytest.MonkeyPatch) -> None:
    stands = Standing.stands
    patch.setattr(Standing, "votes", lambda known, *, is_switch: replace(known, is_switching=is_switch))
    patch.setattr(
        Standing,
        "stands",
        lambda known, accepted, speaker=None: replace(stands(known, accepted, speaker), holder=known.holder),
    )


def asked_for_behind_the_own_vote(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(
        Standing, "may_ask", property(lambda known: known.me in known.scene.everyone and known.releases.allow(known.scene.position))
    )


IN_THE_SOUP: dict[Mutant, int] = {
    no_wait: 30,
    granted_with_an_open_vote: 80,
    granted_whatever_was_decided_since: 40,
    what_is_lent_is_forgotten_at_the_vote: 80,
    observers_are_not_asked: 80,
    a_vote_keeps_the_own_lease: 60,
}
"""Within how many seeds each must be found. It was after 9, 14, 8, 46, 21 and 27 of them."""

BY_PLAN: dict[Mutant, Callable[[], Village]] = {
    votes_of_several_ballots_count: plans.an_early_vote,
    lent_for_no_longer_than_it_seems: plans.clocks_of_a_client_and_its_lender,
    a_wait_no_longer_than_a_lease: plans.clocks_of_a_holder_and_who_waits,
    releases_are_not_durable: plans.an_observer_that_crashes,
    released_and_asked_for_all_the_same: plans.an_observer_that_asks_again,
    asked_for_behind_the_own_vote: plans.a_voter_that_asks_again,
    what_is_lent_is_forgotten_at_a_start: plans.a_lender_that_crashes,
    a_lease_survives_a_start: plans.a_release_and_a_start,
    removals_are_forgotten: plans.who_was_removed,
    granted_with_an_open_removal: plans.a_removal_that_not_all_have_learnt,
    granted_with_an_open_removal_of_an_observer: plans.an_observer_whose_removal_not_all_have_learnt,
    granted_although_others_decide: plans.more_who_decide,
}
