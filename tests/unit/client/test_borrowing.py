"""If this fails, a client signs edits under what is over, gives back what it still uses, or keeps a scene's mode from ever being changed."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from scenefold.base.ids import KeyId, NodeId
from scenefold.client.borrowing import IDLE_S, LENT_S_MAX, RENEW_S, REST_S, RETRY_S, Loan
from scenefold.peer.modes.lender import Borrower, Lender
from scenefold.peer.timing import RENEW_S as NODES_RENEW_S
from scenefold.peer.timing import T_LEASE_S, T_WAIT_S

A, B = NodeId(1), NodeId(2)
RHO = 0.01
RATES = st.floats(1 - RHO, 1 + RHO)


def lent(loan: Loan, *, at: float, answered: float | None = None, position: int = 4, left_s: float = 12.0, back: bool = False) -> Loan:
    return loan.asks(A, at).lent(position, left_s, at, at if answered is None else answered, is_asked_back=back)


def test_the_times_are_those_of_nodes() -> None:
    assert LENT_S_MAX == T_LEASE_S and RENEW_S == NODES_RENEW_S
    assert IDLE_S < RENEW_S, "who does nothing renews nothing"


def test_it_counts_from_the_moment_of_asking() -> None:
    loan = lent(Loan(), at=100.0, answered=103.0, left_s=10.0)
    assert loan.may_sign(4, 109.9) and not loan.may_sign(4, 110.0)
    assert not lent(Loan(), at=100.0, answered=111.0, left_s=10.0).may_sign(4, 111.0)


def test_nobody_lends_for_longer_than_a_lease() -> None:
    assert not lent(Loan(), at=0.0, left_s=1e9).may_sign(4, T_LEASE_S)


def test_below_the_newest_change_of_mode_nothing_is_signed() -> None:
    loan = lent(Loan(), at=0.0)
    assert loan.may_sign(4, 1.0) and not loan.may_sign(5, 1.0)
    assert lent(loan, at=1.0, position=5, left_s=3.0).may_sign(5, 1.0), "a newer one counts though it is shorter"
    assert lent(loan, at=1.0, position=4, left_s=3.0).may_sign(4, 11.9), "of those that allow the same the longer one"
    assert lent(loan, at=13.0, position=3).may_sign(3, 13.0), "what is over is no reason to pass over what is lent now"


def test_what_is_asked_back_serves_what_is_under_way_alone() -> None:
    loan = lent(Loan(), at=0.0).begins()
    loan = lent(loan, at=4.0, back=True)
    assert loan.may_sign(4, 5.0) and not loan.may_begin(4, 5.0)
    assert loan.renews_at(5.0) == math.inf == loan.returns_at and not loan.may_ask(4.0 + REST_S - 0.1)
    ended = loan.ends(6.0)
    assert ended.returns_at == -math.inf
    back = ended.given_back()
    assert not back.may_sign(4, 6.0) and not back.may_ask(8.9) and back.may_ask(9.0)
    again = lent(back, at=9.0)
    assert again.may_begin(4, 9.0)


def test_it_is_renewed_in_time_and_given_back_when_idle() -> None:
    loan = lent(Loan(), at=0.0).begins()
    assert loan.renews_at(0.1) == RENEW_S and loan.returns_at == math.inf
    tried = loan.asks(B, RENEW_S)
    assert tried.renews_at(RENEW_S) == RENEW_S + RETRY_S and tried.lenders == {A, B}
    assert tried.renews_at(12.0) == math.inf, "what is over is asked for by who needs it"
    ended = tried.ends(5.0)
    assert ended.returns_at == 5.0 + IDLE_S == lent(ended, at=7.0).returns_at, "what is renewed beside idleness ends it no later"
    assert Loan().returns_at == math.inf
    assert Loan().asks(A, 1.0).returns_at == 1.0 + IDLE_S, "somebody may have lent whose answer was lost"


@given(
    RATES, RATES, st.floats(0.0, T_LEASE_S), st.floats(0.0, 3.0), st.floats(0.0, 3.0), st.floats(0.0, 1.0), st.floats(-1e6, 1e6)
)  # fmt: skip
def test_no_edit_is_signed_once_the_lender_may_vote_nor_after_t_wait(
    of_client: float, of_lender: float, age_s: float, there_s: float, back_s: float, when: float, offset: float
) -> None:
    """All in true seconds. The lender asked for its lease at 0, the client asks at `age_s`; clocks differ by 1 % at most."""
    asked, answers = age_s, age_s + there_s
    left_s = T_LEASE_S - of_lender * answers
    if left_s <= 0:
        return
    left_s = int(left_s * 1000) / 1000
    lender = Lender().lend(Borrower(KeyId(1), b""), left_s, of_lender * answers)
    client_now = offset + of_client * (answers + back_s)
    loan = Loan().asks(A, offset + of_client * asked).lent(4, left_s, offset + of_client * asked, client_now, is_asked_back=False)
    at = asked + when * 3 * T_LEASE_S
    if at >= answers + back_s and loan.may_sign(4, offset + of_client * at):
        assert lender.is_live(of_lender * at), "who lent votes for no change of mode"
        # Whoever learns of a change learns it after the lender has asked, and waits T_WAIT by a clock that may be fast.
        assert at < T_WAIT_S / (1 + RHO) + 1e-6


class Writers(RuleBasedStateMachine):
    """Whatever happens in whatever order."""

    def __init__(self) -> None:
        super().__init__()
        self.loan, self.now, self.floor = Loan(), 0.0, 0
        self.until = -math.inf
        """Until when the best of all that was lent since the last giving back allows edits at this floor."""
        self.under_way = 0

    @rule(seconds=st.floats(0.0, 5.0))
    def time_goes_on(self, seconds: float) -> None:
        self.now += seconds

    @rule(node=st.sampled_from([A, B]), took=st.floats(0.0, 3.0), left_s=st.floats(0.0, 12.0), back=st.booleans(), above=st.integers(0, 1))
    def asks_and_is_lent(self, node: NodeId, took: float, left_s: float, back: bool, above: int) -> None:
        if self.loan.may_ask(self.now):
            asked_at = self.now
            self.loan = self.loan.asks(node, asked_at)
            self.now += took
            position = self.floor + above
            self.loan = self.loan.lent(position, left_s, asked_at, self.now, is_asked_back=back)
            self.until = max(self.until, asked_at + left_s)

    @rule(node=st.sampled_from([A, B]))
    def asks_in_vain(self, node: NodeId) -> None:
        self.loan = self.loan.asks(node, self.now)

    @rule()
    def the_mode_changes(self) -> None:
        self.floor += 2
        self.until = -math.inf

    @rule()
    def a_write_begins(self) -> None:
        if self.loan.may_begin(self.floor, self.now):
            assert not self.loan.is_asked_back
            self.loan, self.under_way = self.loan.begins(), self.under_way + 1

    @rule()
    def a_write_ends(self) -> None:
        if self.under_way:
            self.loan, self.under_way = self.loan.ends(self.now), self.under_way - 1

    @rule()
    def the_keeper_looks(self) -> None:
        if self.loan.returns_at <= self.now:
            assert not self.under_way and self.loan.lenders
            self.loan, self.until = self.loan.given_back(), -math.inf

    @invariant()
    def what_is_signed_is_lent(self) -> None:
        if self.loan.may_sign(self.floor, self.now):
            assert self.now < self.until and self.loan.lenders

    @invariant()
    def the_keeper_has_something_to_wait_for(self) -> None:
        """Who holds something of ours hears from us again: when we write, or by the keeper."""
        if self.loan.lenders and not self.under_way:
            assert self.loan.returns_at < math.inf


TestWriters = Writers.TestCase
