"""If this fails, one of the parts that leases are made of does not do what specs/26-modes.md says of it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scenefold.base.ids import KeyId, NodeId
from scenefold.peer.modes import Borrower, DecidedScene, Holder, Lender, Releases, Standing, Verdict, verdict
from scenefold.peer.modes.lender import BORROWERS_MAX, PROCESSES_MAX
from scenefold.peer.timing import T_LEASE_S, T_WAIT_S
from scenefold.wire import Ballot, Member, SceneMode, Vote

A, B, C, O, STRANGER = (Member(NodeId(node), bytes(16)) for node in range(1, 6))
REBORN = Member(A.node, b"1" * 16)
SCENE = DecidedScene(4, SceneMode.EDIT, frozenset({A, B, C}), frozenset({O}))
NEXT = replace(SCENE, position=5)
RENDERED = DecidedScene(5, SceneMode.RENDER, SCENE.participants, SCENE.observers)
DIGEST = bytes(range(32))
BALLOT = Ballot(3, A.node)
CLIENT = Borrower(KeyId(7), b"p" * 16)


def settled(me: Member = A, now: float = 0.0) -> Standing:
    """A node that has been running for so long that nothing of before its start matters."""
    return Standing.started(me, SCENE, now - 2 * T_WAIT_S, was_switched=False)


def leased(me: Member = A, now: float = 0.0) -> Standing:
    return settled(me).asks(1, now).granted(1, B.node).granted(1, C.node)


def votes(*members: Member, ballot: Ballot = BALLOT) -> list[Vote]:
    return [Vote(5, ballot, DIGEST, member) for member in members]


# ---------------------------------------------------------------------------------------------------------- granter


@pytest.mark.parametrize(
    "me, asker, have, ends_leases, answer",
    [
        (A, B, 4, False, Verdict.GRANT),
        (A, A, 4, False, Verdict.GRANT),
        (A, O, 4, False, Verdict.GRANT),
        (A, B, 3, False, Verdict.GRANT),
        (A, B, 2, False, Verdict.LACKS_LOG),
        (A, STRANGER, 3, False, Verdict.LACKS_LOG),
        (A, B, 5, False, Verdict.NOT_HERE_YET),
        (A, B, 4, True, Verdict.OPEN),
        (A, STRANGER, 4, False, Verdict.STRANGER),
        (B, REBORN, 4, False, Verdict.STRANGER),
        (REBORN, B, 4, False, Verdict.SILENT),
        (O, B, 4, False, Verdict.SILENT),
    ],
)
def test_who_is_granted_a_lease(me: Member, asker: Member, have: int, ends_leases: bool, answer: Verdict) -> None:
    assert verdict(SCENE, me, asker, have, steady_since=3, ends_leases=ends_leases) is answer


# ----------------------------------------------------------------------------------------------------------- holder


def test_a_majority_of_those_who_decide_makes_a_lease_from_the_moment_of_asking() -> None:
    asked = Holder().ask(4, 9, {A.node, B.node, C.node}, 100.0)
    one = asked.granted(9, A.node).granted(9, A.node).granted(9, STRANGER.node).granted(9, O.node)
    assert one.lease(100.0) is None
    two = one.granted(9, C.node)
    lease = two.lease(100.0 + T_LEASE_S - 0.001)
    assert lease is not None and lease.position == 4
    assert two.lease(100.0 + T_LEASE_S) is None


def test_two_of_four_are_no_majority() -> None:
    asked = Holder().ask(4, 9, {1, 2, 3, 4}, 0.0).granted(9, NodeId(1)).granted(9, NodeId(2))  # type: ignore[arg-type]
    assert asked.lease(1.0) is None


def test_an_answer_to_another_question_counts_for_nothing() -> None:
    asked = Holder().ask(4, 9, {A.node}, 0.0).ask(4, 10, {A.node}, 1.0)
    assert asked.granted(9, A.node).lease(1.0) is None
    assert asked.dropped().granted(10, A.node).lease(1.0) is None


def test_who_asks_again_holds_what_he_has_until_it_is_over() -> None:
    held = Holder().ask(4, 9, {A.node}, 0.0).granted(9, A.node).ask(4, 10, {A.node}, 4.0)
    assert held.lease(T_LEASE_S - 0.1) is not None
    assert held.lease(T_LEASE_S) is None
    assert held.granted(10, A.node).lease(T_LEASE_S + 3.9) is not None


# ----------------------------------------------------------------------------------------------------------- lender


def test_what_is_lent_is_live_a_little_longer_than_it_was_lent_for() -> None:
    lent = Lender().lend(CLIENT, 10.0, 100.0)
    assert lent.is_live(110.4) and lent.borrowers(110.4) == {CLIENT}
    assert not lent.is_live(110.5)
    assert not lent.given_back(CLIENT).is_live(100.0)
    assert lent.given_back(Borrower(CLIENT.key, b"q" * 16)).is_live(100.0), "another process of the same key gave back its own"


def test_lending_again_never_shortens_what_was_lent() -> None:
    assert Lender().lend(CLIENT, 10.0, 100.0).lend(CLIENT, 2.0, 101.0).is_live(110.0)


def test_after_a_start_something_may_be_live() -> None:
    assert Lender.started(50.0).is_live(50.0 + T_WAIT_S - 0.1)
    assert not Lender.started(50.0).is_live(50.0 + T_WAIT_S)


def test_so_many_borrow_and_no_more() -> None:
    lender = Lender()
    for number in range(BORROWERS_MAX):
        lender = lender.lend(Borrower(KeyId(number), b""), 10.0, 0.0)
    assert lender.has_room(Borrower(KeyId(0), b""), 1.0) and not lender.has_room(CLIENT, 1.0)
    assert lender.has_room(CLIENT, 11.0)


def test_one_key_leaves_room_to_others() -> None:
    lender = Lender()
    for number in range(PROCESSES_MAX):
        assert lender.has_room(Borrower(KeyId(1), b"%d" % number), 1.0)
        lender = lender.lend(Borrower(KeyId(1), b"%d" % number), 10.0, 0.0)
    assert not lender.has_room(Borrower(KeyId(1), b"one more"), 1.0) and lender.has_room(Borrower(KeyId(1), b"0"), 1.0)
    assert lender.has_room(Borrower(KeyId(2), b"one more"), 1.0)


# --------------------------------------------------------------------------------------------------------- releases


def test_the_highest_release_counts() -> None:
    released = Releases().release(5).release(3)
    assert not released.allow(4) and released.allow(5)
    heard = released.hear(B, 5).hear(B, 4)
    assert heard.cover(B, 5) and heard.cover(B, 2) and not heard.cover(B, 6) and not heard.cover(C, 1)


# -------------------------------------------------------------------------------------------------- standing: leases


def test_a_participant_with_a_lease_acts_and_lends_by_what_is_left_of_it() -> None:
    standing = leased()
    assert standing.acts_in(1.0) is SceneMode.EDIT
    after, left = standing.lends(CLIENT, 5.0)
    assert left == T_LEASE_S - 5.0 and after.lender.is_live(5.0)
    assert standing.acts_in(T_LEASE_S) is None and not standing.may_lend(CLIENT, T_LEASE_S)


def test_an_observer_acts_and_does_not_lend() -> None:
    standing = settled(O).asks(1, 0.0).granted(1, B.node)
    assert standing.acts_in(1.0) is None, "its own word counts for nothing"
    standing = standing.granted(1, C.node)
    assert standing.acts_in(1.0) is SceneMode.EDIT and not standing.may_lend(CLIENT, 1.0)


def test_without_a_lease_the_mode_is_unknown() -> None:
    assert settled().acts_in(0.0) is None and not settled().may_lend(CLIENT, 0.0)


@pytest.mark.parametrize(
    "accepted",
    [
        DecidedScene(5, SceneMode.EDIT, SCENE.participants - {C}, SCENE.observers),
        DecidedScene(5, SceneMode.EDIT, SCENE.participants, frozenset()),
        DecidedScene(5, SceneMode.EDIT, SCENE.participants | {STRANGER}, SCENE.observers),
    ],
)
def test_an_open_vote_that_changes_who_takes_part_keeps_the_own_grant_back(accepted: DecidedScene) -> None:
    standing = settled().stands(accepted).asks(1, 0.0)
    assert standing.granted(1, B.node).acts_in(0.0) is None
    assert standing.granted(1, B.node).granted(1, C.node).acts_in(0.0) is SceneMode.EDIT


def test_who_is_behind_is_granted_a_lease_until_the_mode_or_those_who_decide_change() -> None:
    def follows(known: Standing, after: DecidedScene) -> Standing:
        return known.decided(after, DIGEST, BALLOT, [], 0.0)

    unwatched = follows(settled(), replace(SCENE, position=5, observers=frozenset()))
    assert (
        unwatched.judges(B, 4) is Verdict.GRANT
        and unwatched.judges(O, 4) is Verdict.LACKS_LOG
        and unwatched.judges(O, 5) is Verdict.STRANGER
    )
    fewer = follows(unwatched, replace(SCENE, position=6, observers=frozenset(), participants=frozenset({A, B})))
    assert fewer.judges(B, 5) is Verdict.LACKS_LOG and fewer.judges(B, 6) is Verdict.GRANT
    assert follows(settled(), RENDERED).judges(B, 4) is Verdict.LACKS_LOG
    assert settled().judges(B, 3) is Verdict.LACKS_LOG, "what was changed before its start it does not know"


def test_a_vote_for_a_switch_ends_the_own_lease_and_asking() -> None:
    voting = leased().asks(2, 1.0).votes(is_switch=True)
    assert voting.acts_in(1.0) is None and not voting.may_ask
    assert voting.granted(2, B.node).granted(2, C.node).acts_in(1.0) is None
    assert not voting.stands(RENDERED).may_ask
    assert voting.stands(None).may_ask, "the disk refused the vote"
    assert voting.stands(NEXT).may_ask, "it voted for something else in a later ballot"
    assert leased().votes(is_switch=False).acts_in(1.0) is SceneMode.EDIT


def test_what_is_lent_keeps_from_voting_for_a_switch_alone() -> None:
    lent, _ = leased().lends(CLIENT, 1.0)
    assert lent.abstains(is_switch=True, now=2.0) and not lent.abstains(is_switch=False, now=2.0)
    assert not lent.given_back(CLIENT).abstains(is_switch=True, now=2.0)
    assert Standing.started(A, SCENE, 0.0).abstains(is_switch=True, now=T_WAIT_S - 0.1)


def test_a_release_ends_the_lease_and_asking_below_it() -> None:
    released = settled(O).asks(1, 0.0).granted(1, A.node).granted(1, B.node).releasing(5)
    assert released.acts_in(0.0) is None and not released.may_ask and released.releases.own == 5
    assert not Standing.started(O, SCENE, 0.0, released=5).may_ask, "also after a start"
    other = DecidedScene(5, SceneMode.EDIT, SCENE.participants, SCENE.observers)
    assert released.decided(other, DIGEST, BALLOT, (), 1.0).may_ask, "something else was decided there"


def test_who_has_missed_positions_releases_the_newest_and_waits_if_the_mode_may_have_changed() -> None:
    later = DecidedScene(9, SceneMode.EDIT, SCENE.participants, SCENE.observers)
    standing = settled(O).asks(1, 0.0).granted(1, A.node).granted(1, B.node)
    jumped = standing.jumped(later, 1.0, was_switched=True)
    assert jumped.acts_in(1.0) is None and jumped.release(1.0) == 9 and jumped.may_ask
    assert jumped.heard(O, 9).release(1.0) is None, "it has been said"
    assert not jumped.heard(A, 9).is_active(1.0 + T_WAIT_S - 0.1) and jumped.is_active(1.0 + T_WAIT_S), "of whom, it does not know"
    same = standing.jumped(later, 1.0, was_switched=False)
    assert same.acts_in(1.0) is SceneMode.EDIT and same.release(1.0) is None
    assert standing.jumped(replace(later, observers=frozenset()), 1.0, was_switched=False).holder.lease(1.0) is None


def test_an_observer_that_starts_may_say_that_it_uses_nothing_of_before() -> None:
    started = Standing.started(O, RENDERED, 0.0, released=5)
    assert started.release(0.0) == 5 and started.heard(O, 5).release(0.0) is None and started.may_ask
    assert Standing.started(STRANGER, RENDERED, 0.0, released=5).release(0.0) is None


def test_other_entries_end_no_lease_but_the_own_removal_does() -> None:
    other = DecidedScene(5, SceneMode.EDIT, SCENE.participants, SCENE.observers)
    lease = leased().decided(other, DIGEST, BALLOT, (), 1.0).holder.lease(1.0)
    assert lease is not None and lease.position == 4, "and it stays one of its position"
    without = replace(other, participants=SCENE.participants - {A})
    assert leased().decided(without, DIGEST, BALLOT, (), 1.0).holder.lease(1.0) is None


# ---------------------------------------------------------------------------------------------- standing: activation


def switched(*who: Member, me: Member = A, ballot: Ballot = BALLOT) -> Standing:
    return leased(me).decided(RENDERED, DIGEST, BALLOT, votes(*who, ballot=ballot), 1.0)


def test_a_switch_ends_the_lease_and_waits() -> None:
    standing = switched(A, B)
    assert standing.holder.lease(1.0) is None
    assert not standing.is_active(1.0 + T_WAIT_S - 0.1) and standing.is_active(1.0 + T_WAIT_S)


def test_all_votes_and_the_observers_release_make_it_active_at_once() -> None:
    standing = switched(A, B, C)
    assert not standing.is_active(1.0)
    assert not standing.heard(O, 4).is_active(1.0)
    assert standing.heard(O, 5).is_active(1.0) and standing.heard(O, 9).is_active(1.0)


def test_votes_may_come_later_and_a_release_stands_for_a_vote() -> None:
    standing = switched(A, B).heard(O, 5)
    (vote,) = votes(C)
    assert standing.voted(vote).is_active(1.0)
    assert standing.heard(C, 5).is_active(1.0)
    assert not standing.voted(replace(vote, digest=bytes(32))).is_active(1.0)
    assert not standing.voted(replace(vote, position=4)).is_active(1.0)
    assert not standing.voted(replace(vote, member=STRANGER)).is_active(1.0)


def test_votes_of_a_ballot_before_the_certificates_show_nothing() -> None:
    standing = switched(A, B).heard(O, 5)
    assert not standing.voted(votes(C, ballot=Ballot(2, C.node))[0]).is_active(1.0)
    assert standing.voted(votes(C, ballot=Ballot(4, C.node))[0]).is_active(1.0), "nothing else can be voted for then"


def test_no_shortcut_while_a_removal_is_new() -> None:
    removed = DecidedScene(5, SceneMode.EDIT, SCENE.participants - {C}, SCENE.observers)
    standing = settled().decided(removed, DIGEST, BALLOT, (), 1.0)
    after = DecidedScene(6, SceneMode.RENDER, removed.participants, removed.observers)
    votes_of_six = [Vote(6, BALLOT, DIGEST, member) for member in (A, B)]
    standing = standing.decided(after, DIGEST, BALLOT, votes_of_six, 2.0).heard(O, 6)
    assert not standing.is_active(1.0 + T_WAIT_S - 0.1) and standing.is_active(1.0 + T_WAIT_S)


def test_what_is_active_stays_so_when_somebody_is_removed() -> None:
    standing = switched(A, B, C).heard(O, 5)
    removed = DecidedScene(6, SceneMode.RENDER, SCENE.participants - {C}, SCENE.observers)
    assert standing.decided(removed, DIGEST, BALLOT, (), 2.0).is_active(2.0)


def test_a_start_waits_again_whatever_is_on_the_disk() -> None:
    started = Standing.started(A, RENDERED, 50.0)
    assert not started.is_active(50.0 + T_WAIT_S - 0.1) and started.is_active(50.0 + T_WAIT_S)
    assert Standing.started(A, SCENE, 50.0, was_switched=False).is_active(50.0), "there was never another mode"


def test_who_must_not_speak_yet_releases_nothing_by_what_it_has_decided() -> None:
    """Its disk may be an older one, of before it lent anything."""
    silent = settled().stands(None, replace(A, incarnation=b"0" * 15 + b"?")).decided(RENDERED, DIGEST, BALLOT, (), 1.0)
    assert silent.release(1.0) is None
    assert silent.stands(None, A).release(1.0) == 5


def test_who_has_decided_it_may_release_when_nothing_is_lent() -> None:
    lent, _ = leased().lends(CLIENT, 0.5)
    assert lent.release(0.5) is None
    after = lent.decided(RENDERED, DIGEST, BALLOT, votes(B, C), 1.0)
    assert after.release(1.0) is None
    assert after.given_back(CLIENT).release(1.0) == 5
    assert after.given_back(CLIENT).heard(A, 5).release(1.0) is None, "it has said so"
