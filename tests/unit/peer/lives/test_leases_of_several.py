"""If this fails, a voter grants what it must not, a node counts a lease that it has not, or a voter whose disk was put back votes."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.awakening import Awakening
from scenefold.peer.cluster_log.lease_asker import LeaseAsker
from scenefold.peer.cluster_log.lease_grants import Answer, Held, Question, Verdict, answer, noted
from scenefold.peer.cluster_log.lives import Lives
from scenefold.peer.cluster_log.numbered_lives import NOBODYS, Life, merged, of_one_voter, takes, together, unpack_life
from scenefold.peer.cluster_log.telling_lives import Gathering, gather, may_vote, to_ask, told
from scenefold.peer.cluster_log.voter_rules import Council
from scenefold.peer.timing import LIFE_S, T_LEASE_S
from scenefold.wire import Member
from unit.peer.lives.lives_world import Entry, Sight, member, voters

WRONG_INCARNATION = RejectReason.WRONG_INCARNATION
LIVES = st.builds(Life, st.integers(0, 4), st.integers(0, 2))
NODE = member(9)
THREE = Sight(5, (Council(1, voters(frozenset({0}))), Council(3, voters(frozenset({0, 1, 2})))), frozenset({*map(member, range(3)), NODE}))
READY = Held(ready_at=3)


def said(
    question: Question, held: Held = READY, log: Sight = THREE, me: Member = NODE, *, awake: bool = True, accepted: bool = False
) -> Answer:
    me = member(0) if me == NODE else me
    return answer(question, held, log, me, is_awake=awake, has_accepted=accepted)


def asks(life: Life, have: int = 5, who: Member = NODE) -> Question:
    return Question(who, have, life, 7)


# --------------------------------------------------------------------------------------------------------- lives


@given(LIVES, LIVES)
def test_of_each_number_a_voter_takes_one_life(one: Life, other: Life) -> None:
    assert takes(None, one) and takes(one, one)
    assert not (takes(one, other) and takes(other, one)) or one == other
    assert takes(one, other) is (other == one or other.number > one.number)


@given(st.lists(LIVES, min_size=1, max_size=5), st.randoms())
def test_in_whatever_order_lives_are_told_the_same_is_held(lives: list[Life], order: object) -> None:
    held = None
    for life in lives:
        held = together(held, life)
    highest = {life for life in lives if life.number == max(lives).number}
    assert held == (highest.pop() if len(highest) == 1 else Life(max(lives).number, NOBODYS))
    again = None
    for life in sorted(lives, reverse=True):
        again = together(again, life)
    assert again == held and together(held, lives[0]) in (held, Life(held.number, NOBODYS))
    assert merged({b"a": lives[0]}, {b"b": lives[-1]}) == {b"a": lives[0], b"b": lives[-1]}


def test_lives_are_kept_as_they_were() -> None:
    life = Life(2**64 - 1, 2**63)
    assert unpack_life(life.pack()) == life
    for data in (b"", life.pack()[1:], life.pack() + b"?"):
        with pytest.raises(DamagedData):
            unpack_life(data)


# ----------------------------------------------------------------------------------------------------- the voter


def test_a_life_is_noted_before_a_lease_is_granted_under_it() -> None:
    question = asks(Life(4, 11))
    assert said(question) is Verdict.NOTE
    held = noted(READY, question)
    assert said(question, held) is Verdict.GRANT
    assert said(asks(Life(5, 1)), held) is Verdict.NOTE
    for older in (Life(3, 11), Life(4, 12)):
        assert said(asks(older), held) is WRONG_INCARNATION
    assert said(asks(Life(4, NOBODYS))) is RejectReason.ILL_FORMED


def test_who_is_no_member_is_refused_before_all_else() -> None:
    assert said(asks(Life(1, 1), who=member(8))) is RejectReason.NOT_AUTHORISED
    gone = THREE.after(Entry(removes=NODE))
    assert said(asks(Life(1, 1), have=6), log=gone) is WRONG_INCARNATION


@pytest.mark.parametrize(("have", "is_granted"), [(2, False), (3, True), (5, True), (6, False)])
def test_a_lease_is_of_who_votes_since_what_the_asker_knows(have: int, is_granted: bool) -> None:
    assert said(asks(Life(1, 1), have)) is (Verdict.NOTE if is_granted else Verdict.NOT_NOW)


def test_who_has_voted_is_not_ready_or_not_awake_grants_nothing() -> None:
    question = asks(Life(1, 1))
    assert said(question, accepted=True) is Verdict.WAIT
    assert said(question, awake=False) is said(question, Held()) is said(question, Held(ready_at=1)) is Verdict.NOT_NOW
    assert said(question, me=member(7)) is Verdict.NOT_NOW, "no voter"
    # But it tells whoever is an older one.
    held = Held({NODE.incarnation: Life(2, 2)})
    for state in (held, replace(held, ready_at=3)):
        assert said(question, state, awake=False) is said(question, state, accepted=True) is WRONG_INCARNATION


# ---------------------------------------------------------------------------------------------- those who come


def test_who_granted_alone_is_ready_at_once_and_others_hear_of_a_majority() -> None:
    alone = Sight(1, THREE.councils[:1], THREE.members)
    assert gather(Gathering(), Held(), alone, member(0)) == (Gathering(), Held(ready_at=1))
    assert gather(Gathering(), Held(), alone, member(1)) == (Gathering(), Held())
    gathering, held = gather(Gathering(), Held(), THREE, member(1))
    assert to_ask(gathering, THREE) == (member(0),) and not may_vote(changes_voters=True, held=held, log=THREE, me=member(1))
    assert may_vote(changes_voters=False, held=held, log=THREE, me=member(1))
    lives = {b"x": Life(3, 3)}
    for stranger, at in ((member(2), 3), (member(0), 1)):
        assert told(gathering, held, stranger, at, lives, THREE, is_all=True) == (gathering, held)
    gathering, held = told(gathering, held, member(0), 3, lives, THREE, is_all=False)
    assert held == Held(lives) and gathering.council_at == 3, "more pages come"
    gathering, held = told(gathering, held, member(0), 3, {b"y": Life(1, 1)}, THREE, is_all=True)
    assert held == Held({**lives, b"y": Life(1, 1)}, ready_at=3) and not to_ask(gathering, THREE)


def test_who_stays_counts_itself_if_it_was_ready() -> None:
    after = THREE.after(Entry(council=frozenset({0, 1, 4})))
    for ready_at, heard in ((3, {member(0)}), (1, set())):
        gathering, held = gather(Gathering(), Held(ready_at=ready_at), after, member(0))
        assert gathering == Gathering(6, frozenset(heard)) and held.ready_at == ready_at
    gathering, held = gather(Gathering(), READY, after, member(0))
    gathering, held = told(gathering, held, member(2), 6, {}, after, is_all=True)
    assert held.ready_at == 6
    # What changes meanwhile is begun anew.
    gathering, _ = gather(Gathering(), READY, after, member(1))
    later = after.after(Entry(council=frozenset({0, 1, 2})))
    assert gather(gathering, READY, later, member(1))[0] == Gathering(7)


# --------------------------------------------------------------------------------------------------------- a node


def granted_by(asker: LeaseAsker, *numbers: int, nonce: int = 1) -> LeaseAsker:
    for number in numbers:
        asker = asker.granted(nonce, member(number))
    return asker


def test_a_lease_counts_from_the_question_and_by_a_majority() -> None:
    asker = LeaseAsker.of_disk(())
    assert asker.wants_life(0.0)
    asker = asker.drawn(5, 10.0)
    assert asker.life == Life(0, 5) and not asker.wants_life(99.0), "none is drawn before this one is granted"
    asker = asker.asks(1, 5, THREE.councils[-1].voters, 20.0)
    for nothing in (granted_by(asker, 1), granted_by(asker, 1, 1), granted_by(asker, 1, 7), granted_by(asker, 1, 2, nonce=2)):
        assert not nothing.holds(20.0) and not nothing.is_granted
    held = granted_by(asker, 2, 0)
    assert held.is_granted and held.until == 20.0 + T_LEASE_S and held.holds(31.9) and not held.holds(32.0)
    assert not held.removed().holds(20.0)
    assert not held.wants_life(10.0 + LIFE_S - 0.1) and held.wants_life(10.0 + LIFE_S) and held.drawn(6, 70.0).life == Life(1, 6)


def test_a_grant_under_a_life_of_an_earlier_process_is_no_lease() -> None:
    asker = LeaseAsker.of_disk([Life(3, 5)])
    assert not asker.wants_life(50.0)
    asker = granted_by(asker.asks(1, 5, THREE.councils[-1].voters, 50.0), 0, 1)
    assert asker.is_granted and not asker.holds(50.0) and asker.wants_life(50.0)
    late = granted_by(asker.drawn(9, 60.0).asks(1, 5, THREE.councils[-1].voters, 60.0 + LIFE_S), 0, 1)
    assert late.is_granted and not late.holds(60.0 + LIFE_S)


def test_a_node_is_told_when_those_who_have_not_refused_are_no_majority() -> None:
    asker = LeaseAsker.of_disk([Life(3, 5)]).asks(1, 5, THREE.councils[-1].voters, 50.0)
    once = asker.refused(1, member(0), WRONG_INCARNATION).refused(1, member(0), WRONG_INCARNATION)
    other = (
        once.refused(1, member(1), RejectReason.NOT_AUTHORISED)
        .refused(2, member(1), WRONG_INCARNATION)
        .refused(1, member(7), WRONG_INCARNATION)
    )
    assert not other.is_restored and granted_by(other, 1, 2).is_granted
    assert once.refused(1, member(2), WRONG_INCARNATION).is_restored


def test_a_life_of_one_voter_is_known_by_one_of_two_marks() -> None:
    """It may have been granted, and the answer lost. Then the one before is refused, else the one that was drawn behind it."""
    alone = voters(frozenset({0}))
    for lives, marks in ((Lives(), []), (Lives(0, 4), [4]), (Lives(3, 4), [4, 3])):
        assert of_one_voter(lives) == tuple(Life(0, mark) for mark in marks)
    for known in (3, 4):
        held, asker = Held({NODE.incarnation: Life(0, known)}, ready_at=1), LeaseAsker.of_disk(of_one_voter(Lives(3, 4)))
        for _ in range(2):
            if asker.is_granted:
                break
            assert asker.life is not None
            asker = asker.asks(1, 5, alone, 0.0)
            verdict = said(asks(asker.life or Life(0, 0), 2), held, Sight(2, THREE.councils[:1], THREE.members))
            is_refused = verdict is WRONG_INCARNATION
            asker = asker.refused(1, member(0), WRONG_INCARNATION) if is_refused else granted_by(asker, 0)
        assert asker.is_granted and asker.life == Life(0, known) and asker.drawn(8, 0.0).life == Life(1, 8)
    lagging = LeaseAsker.of_disk(of_one_voter(Lives(1, 2)))
    for _ in range(2):
        lagging = lagging.asks(1, 5, alone, 0.0).refused(1, member(0), WRONG_INCARNATION)
    assert lagging.is_restored
    # Nor is a copy granted from before the first life was drawn.
    copy = LeaseAsker.of_disk(of_one_voter(Lives())).drawn(9, 0.0)
    assert copy.life is not None and said(asks(copy.life, 2), held, Sight(2, THREE.councils[:1], THREE.members)) is WRONG_INCARNATION


# ------------------------------------------------------------------------------------------------- a voter's start


def test_a_voter_votes_once_a_majority_knows_of_no_later_life_of_it() -> None:
    five = voters(frozenset(range(5)))
    awakening = Awakening().looked_at(five, member(0))
    assert not awakening.is_awake and Awakening().looked_at(voters(frozenset({0})), member(0)).is_awake
    awakening = awakening.answered(member(1), is_refused=False).answered(member(0), is_refused=False).answered(member(9), is_refused=False)
    assert not awakening.looked_at(five, member(0)).is_awake, "itself, and who is no voter, say nothing"
    awake = awakening.answered(member(2), is_refused=False).looked_at(five, member(0))
    assert awake.is_awake and awake.answered(member(3), is_refused=True) == awake
    over = awakening.answered(member(2), is_refused=True)
    assert over.is_over and not over.answered(member(3), is_refused=False).looked_at(five, member(0)).is_awake
    assert not Awakening().looked_at(five, member(9)).is_awake, "who is no voter has nothing to wake for"
