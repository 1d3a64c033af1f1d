"""If this fails, nodes without a scene's key believe a header that its participants did not decide, or none that they did."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, LocalFault, Refused
from scenefold.base.ids import NodeId
from scenefold.base.limits import CERTIFICATE_BYTES_MAX, DECIDERS_MAX
from scenefold.base.reasons import RejectReason
from scenefold.peer.scene_log.headers import checked_header
from scenefold.scene.log import CHANGES_MAX, Undecided, changes_before, check_decided, check_told, decided, decided_by_votes
from scenefold.scene.log.certified import BY_PARTICIPANTS
from scenefold.wire import Ballot, Decision, Role, SceneCertificate, SceneLogPublic, SceneMode, SetMode
from unit.scene.log.council import Council, added, node, removed, vote
from unit.scene.log.members import grant
from unit.scene.log.test_grants import KEEPER_KEY

BALLOT = Ballot(4, NodeId(2))


@lru_cache(None)
def grown() -> Council:
    """A scene that has had others to decide, and has changed otherwise, too."""
    council = Council()
    council.decide(grant(1, Role.WRITER))
    council.decide(added(4), BALLOT)
    council.decide(added(5))
    council.decide(SetMode(SceneMode.RENDER))
    council.decide(removed(1))
    council.decide(grant(2))
    return council


def certificates(header: SceneLogPublic) -> list[SceneCertificate]:
    assert header.decision is not None and header.decision.form == BY_PARTICIPANTS
    return [SceneCertificate.decode(data) for data in header.decision.certificates]


def with_certificates(header: SceneLogPublic, found: list[SceneCertificate]) -> SceneLogPublic:
    return replace(header, decision=Decision(BY_PARTICIPANTS, tuple(one.encode() for one in found)))


def test_certificates_lead_from_the_origin_to_who_decides_now() -> None:
    council = grown()
    for header in council.headers:
        check_decided(header)
    chain = certificates(council.header)
    assert [one.position for one in chain] == [1, 3, 4, 6, 7], "those of changes, and its own"
    assert [len(one.votes) for one in chain] == [1, 2, 3, 3, 3], "the origin alone, then a majority"
    assert [len(one.participants) for one in chain] == [3, 4, 5, 4, 0]
    assert council.header.participants == tuple(node(number) for number in (2, 3, 4, 5)) == council.state.roster.participants
    assert changes_before(council.header) == 4


def test_a_header_that_changes_who_decides_is_decided_by_those_before() -> None:
    council = Council(first=(1,))
    header = council.decide(added(2))
    assert [vote.node for vote in certificates(header)[-1].votes] == [1]
    council.decide(removed(1))
    assert [vote.node for vote in certificates(council.decide(grant(3)))[-1].votes] == [2]


def test_a_scene_of_its_origin_may_get_participants_later() -> None:
    council = Council(first=())
    council.do(grant(1))
    assert council.header.decision is not None and council.header.decision.form == 1
    council.do(added(7))
    council.decide(grant(2))
    assert [one.position for one in certificates(council.header)] == [3, 4]


def test_the_origin_decides_alone_no_more() -> None:
    council = Council()
    offered = council.offer(grant(1)).header
    with pytest.raises(Refused, match="had decide first") as caught:
        checked_header(decided(offered, KEEPER_KEY), council.known)
    assert caught.value.reason is RejectReason.NOT_AUTHORISED
    with pytest.raises(Refused, match="forgets that others"):
        checked_header(decided(replace(offered, participants=()), KEEPER_KEY), council.known)
    with pytest.raises(Undecided, match="form of one with others"):
        check_decided(replace(council.header, participants=()))


def test_too_few_votes_are_no_decision() -> None:
    council = Council(first=(1, 2, 3, 4))
    offered = council.offer(grant(1))
    votes = council.votes(council.value(offered), BALLOT)
    with pytest.raises(LocalFault, match="no majority"):
        decided_by_votes(offered.header, council.header, BALLOT, votes[:2])
    with pytest.raises(LocalFault, match="no majority"):
        decided_by_votes(offered.header, council.header, Ballot(5, NodeId(2)), votes)
    check_decided(decided_by_votes(offered.header, council.header, BALLOT, votes[1:]))


def _last(edit: Callable[[SceneCertificate], SceneCertificate]) -> Callable[[list[SceneCertificate]], list[SceneCertificate]]:
    return lambda chain: [*chain[:-1], edit(chain[-1])]


FORGED: dict[str, Callable[[list[SceneCertificate]], list[SceneCertificate]]] = {
    "none": lambda chain: [],
    "without the first": lambda chain: chain[1:],
    "without a change": lambda chain: [*chain[:1], *chain[2:]],
    "without the last change": lambda chain: [*chain[:-2], chain[-1]],
    "without its own": lambda chain: chain[:-1],
    "its own twice": lambda chain: [*chain, chain[-1]],
    "in another order": lambda chain: [chain[0], chain[2], chain[1], *chain[3:]],
    "a vote too few": _last(lambda one: replace(one, votes=one.votes[:-1])),
    "one vote twice": _last(lambda one: replace(one, votes=(*one.votes[:-1], one.votes[0]))),
    "in the name of another": _last(lambda one: replace(one, votes=(*one.votes[:-1], replace(one.votes[-1], node=NodeId(5))))),
    "in the name of nobody": _last(lambda one: replace(one, votes=(*one.votes[:-1], replace(one.votes[-1], node=NodeId(99))))),
    "in another ballot": _last(lambda one: replace(one, ballot=Ballot(9, NodeId(9)))),
    "at another position": _last(lambda one: replace(one, position=one.position + 1)),
    "naming others": _last(lambda one: replace(one, participants=(node(2), node(3), node(4)))),
    "naming who decided it": _last(lambda one: replace(one, participants=(node(2), node(3), node(4), node(5)))),
}


@pytest.mark.parametrize("what", FORGED)
def test_a_chain_with_a_link_that_is_none_shows_nothing(what: str) -> None:
    header = grown().header
    with pytest.raises(Undecided):
        check_decided(with_certificates(header, FORGED[what](certificates(header))))


def test_a_link_cannot_be_left_out_because_the_votes_happen_to_be_enough() -> None:
    """Two of three voted before a fourth came; two votes of then are no decision of four."""
    council = Council(first=(1, 2, 3))
    before = council.header
    council.decide(added(4))
    offered = council.offer(grant(1))
    two = council.votes(council.value(offered), BALLOT)[:2]
    # What two of the four have signed, shown as if the fourth came with it.
    for known in (before, replace(council.header, decision=before.decision)):
        with pytest.raises(LocalFault):
            decided_by_votes(offered.header, known, BALLOT, two)
    chain = certificates(before)
    own = certificates(council.header)[-1]
    signatures = tuple(replace(one, signature=vote.signature) for one, vote in zip(own.votes, two, strict=True))
    forged = replace(own, position=offered.header.position, ballot=BALLOT, votes=signatures)
    with pytest.raises(Undecided):
        check_decided(with_certificates(offered.header, [*chain, forged]))


def test_votes_of_a_wiped_node_count_no_more() -> None:
    council = Council(first=(1, 2))
    offered = council.offer(grant(1))
    value = council.value(offered)
    votes = [*council.votes(value, BALLOT)[:1], vote(node(2, life=1), value, 2, council.header.genesis, BALLOT)]
    with pytest.raises(LocalFault, match="no majority"):
        decided_by_votes(offered.header, council.header, BALLOT, votes)


def test_whichever_votes_show_it_a_header_is_the_same() -> None:
    council = Council()
    offered = council.offer(grant(1))
    votes = council.votes(council.value(offered), BALLOT)
    one, other = (decided_by_votes(offered.header, council.header, BALLOT, some) for some in (votes[:2], votes[1:]))
    assert one.decision != other.decision
    assert checked_header(other, checked_header(one, council.known)).public.signable() == one.signable()


HEADER = grown().header
SIZE = sum(map(len, HEADER.decision.certificates)) if HEADER.decision else 0


@settings(max_examples=300, deadline=None)
@given(st.integers(0, 8 * SIZE - 1))
def test_any_bit_of_a_certificate_counts(bit: int) -> None:
    assert HEADER.decision is not None
    chain, at = list(HEADER.decision.certificates), bit // 8
    which = 0
    while at >= len(chain[which]):
        at, which = at - len(chain[which]), which + 1
    bent = bytearray(chain[which])
    bent[at] ^= 1 << bit % 8
    chain[which] = bytes(bent)
    with pytest.raises(Undecided):
        check_decided(replace(HEADER, decision=Decision(BY_PARTICIPANTS, tuple(chain))))


def test_a_reader_holds_a_header_to_its_log() -> None:
    """Who decides cannot read the log, so it would take these."""
    council = grown()
    check_told(council.header, council.state)
    for changed in (
        replace(council.header, participants=council.header.participants[1:]),
        replace(council.header, observers=(node(9),)),
        replace(council.header, key_epoch=1),
    ):
        with pytest.raises(DamagedData, match="the scene's log and its header name other"):
            check_told(changed, council.state)


def test_the_largest_certificate_fits() -> None:
    council = Council(first=tuple(range(1, DECIDERS_MAX)))
    header = council.decide(added(2**32 - 1))
    assert header.decision is not None
    assert 3_000 < max(map(len, header.decision.certificates)) < CERTIFICATE_BYTES_MAX
    # Beyond these a header has no room for its own.
    assert CHANGES_MAX == 127
