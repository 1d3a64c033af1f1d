"""If this fails, an invitation admits twice, whom it was not for, or whose key was revoked; or trust outlives the key that was trusted."""

from __future__ import annotations

import datetime
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import Refused
from scenefold.base.ids import node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.wire.enrol_entries import ANY_NODE, Enrol, EnrolEntry, Invite, RenewCard, RevokeUser, Trust, Withdraw
from scenefold.wire.orders import EnrolForm
from scenefold.world.roll import InvitationState, Roll
from unit.peer.members_made import NEWCOMERS, NOW, card_for, enrolled, invitation_key

FIVE = node_id_of("127.0.0.5")
NODE = f"node:{FIVE}"
KEY = NEWCOMERS[0].sealing.public.raw
YEAR = datetime.timedelta(days=365)


def invite(number: int, name: str, *, admin: bool = False) -> Invite:
    return Invite(invitation_key(number).public.raw, name, admin, int(NOW.timestamp()) + 3600, "user:owner")


def enrol(number: int, name: str, who: int = 0, *, admin: bool = False) -> Enrol:
    return enrolled(number, card_for(name, who, admin=admin))


def after(*entries: EnrolEntry, roll: Roll | None = None) -> Roll:
    roll = roll or Roll()
    for entry in entries:
        roll = roll.after(entry)
    return roll


def refusal(roll: Roll, entry: EnrolEntry) -> RejectReason:
    with pytest.raises(Refused) as caught:
        roll.after(entry)
    return caught.value.reason


def test_an_invitation_is_used_once_for_the_name_that_it_gives() -> None:
    roll = after(invite(1, "user:ada"))
    assert refusal(roll, enrol(1, "user:eve")) == RejectReason.NOT_AUTHORISED
    assert refusal(roll, enrol(1, NODE)) == RejectReason.NOT_AUTHORISED
    assert refusal(roll, enrol(1, "user:ada", admin=True)) == RejectReason.NOT_AUTHORISED, "nobody invited an administrator"
    assert refusal(roll, enrol(2, "user:ada")) == RejectReason.NOT_AUTHORISED, "another invitation"
    used = after(enrol(1, "user:ada"), roll=roll)
    assert used.invitations[invitation_key(1).public.raw].state is InvitationState.USED
    card = used.card_of("user:ada")
    assert card is not None and card.name == "user:ada"
    for who in range(2):
        assert refusal(used, enrol(1, "user:ada", who)) == RejectReason.NOT_AUTHORISED
    assert refusal(used, invite(2, "user:ada")) == RejectReason.NOT_AUTHORISED
    assert refusal(used, invite(1, "user:bob")) == RejectReason.ILL_FORMED
    assert refusal(used, Withdraw(invitation_key(1).public.raw)) == RejectReason.NOT_AUTHORISED


def test_what_was_withdrawn_admits_nobody() -> None:
    roll = after(invite(1, ANY_NODE), Withdraw(invitation_key(1).public.raw))
    assert refusal(roll, enrol(1, NODE)) == RejectReason.NOT_AUTHORISED


@pytest.mark.parametrize(
    "entry", [invite(1, "ada"), invite(1, "user:"), invite(1, "node:1", admin=True), RevokeUser(NODE, NEWCOMERS[0].signing.key_id)]
)
def test_names_that_cannot_be_are_refused(entry: EnrolEntry) -> None:
    assert refusal(Roll(), entry) == RejectReason.ILL_FORMED


def test_a_revoked_key_never_comes_back_and_the_name_may() -> None:
    roll = after(invite(1, "user:ada"), enrol(1, "user:ada"), RevokeUser("user:ada", NEWCOMERS[0].signing.key_id), invite(2, "user:ada"))
    assert roll.card_of("user:ada") is None
    assert refusal(roll, enrol(2, "user:ada")) == RejectReason.KEY_REVOKED
    assert refusal(roll, RenewCard(card_for("user:ada", 0, since=YEAR).der)) == RejectReason.KEY_REVOKED
    back = after(enrol(2, "user:ada", 1), roll=roll).card_of("user:ada")
    assert back is not None and back.keys.signing == NEWCOMERS[1].signing.public


def test_who_is_revoked_does_not_come_back_by_an_invitation_that_it_gave() -> None:
    mine, others = replace(invite(2, "user:eve"), by="user:ada"), invite(3, "user:bob")
    used = replace(invite(4, "user:cat"), by="user:ada")
    roll = after(invite(1, "user:ada"), enrol(1, "user:ada"), mine, others, used, enrol(4, "user:cat", 1))
    gone = roll.after(RevokeUser("user:ada", NEWCOMERS[0].signing.key_id))
    states = [gone.invitations[invitation_key(number).public.raw].state for number in (2, 3, 4)]
    assert states == [InvitationState.WITHDRAWN, InvitationState.OPEN, InvitationState.USED]
    assert refusal(gone, enrol(2, "user:eve", 2)) == RejectReason.NOT_AUTHORISED


def test_only_an_invitation_that_names_a_node_gives_it_other_keys_and_they_are_not_trusted() -> None:
    roll = after(invite(1, ANY_NODE), enrol(1, NODE), Trust(FIVE, True, KEY, b"sealed"), invite(2, ANY_NODE), invite(3, NODE))
    assert refusal(roll, enrol(2, NODE, 1)) == RejectReason.NOT_AUTHORISED
    again = after(enrol(3, NODE, 1), roll=roll)
    assert FIVE not in again.trusted and not again.sealed


def test_keys_that_were_replaced_count_no_longer() -> None:
    roll = after(invite(1, ANY_NODE), enrol(1, NODE), invite(2, NODE), enrol(2, NODE, 1), invite(3, NODE))
    assert roll.is_revoked(NODE, NEWCOMERS[0].signing.key_id) and not roll.is_revoked(NODE, NEWCOMERS[1].signing.key_id)
    assert refusal(roll, enrol(3, NODE, 0)) == RejectReason.KEY_REVOKED, "nobody puts an old card back"
    same = after(enrol(3, NODE, 1), roll=roll)
    assert not same.is_revoked(NODE, NEWCOMERS[1].signing.key_id)


def test_only_members_that_count_take_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenefold.world.roll.LISTED_MAX", 1)
    roll = after(invite(1, "user:ada"), enrol(1, "user:ada"), invite(2, "user:bob"))
    assert refusal(roll, enrol(2, "user:bob", 1)) == RejectReason.LIMIT_EXCEEDED
    assert after(RevokeUser("user:ada", NEWCOMERS[0].signing.key_id), enrol(2, "user:bob", 1), roll=roll).card_of("user:bob")


def test_trust_goes_with_the_key_or_when_it_is_withdrawn() -> None:
    roll = after(invite(1, ANY_NODE), enrol(1, NODE), Trust(FIVE, True, KEY), Trust(FIVE, True, KEY, b"sealed"))
    assert roll.trusted == {FIVE} and roll.sealed == {FIVE: b"sealed"}
    for gone in (after(Trust(FIVE, False), roll=roll), roll.without(NODE, NEWCOMERS[0].signing.key_id)):
        assert not gone.trusted and not gone.sealed


@pytest.mark.parametrize("entry", [Trust(FIVE, True), Trust(FIVE, False, KEY), Trust(FIVE, False, b"", b"sealed")])
def test_trust_says_what_may_be_sealed_to(entry: Trust) -> None:
    assert refusal(Roll(), entry) == RejectReason.ILL_FORMED


def test_a_renewed_card_has_the_same_keys() -> None:
    roll = after(invite(1, "user:ada"), enrol(1, "user:ada"))
    assert refusal(roll, RenewCard(card_for("user:ada", 1, since=YEAR).der)) == RejectReason.NOT_AUTHORISED
    assert refusal(roll, RenewCard(card_for("user:ada", 0, admin=True, since=YEAR).der)) == RejectReason.NOT_AUTHORISED
    assert refusal(roll, RenewCard(roll.cards["user:ada"].der)) == RejectReason.ILL_FORMED, "it is the same"
    assert refusal(roll, RenewCard(b"no card")) == RejectReason.ILL_FORMED
    newer = after(RenewCard(card_for("user:ada", 0, since=YEAR).der), roll=roll).card_of("user:ada")
    assert newer is not None and newer.not_after > card_for("user:ada", 0).not_after
    # What a wrong clock dated is not for ever: by whose calendar a card is judged says the voter (card_rules.py).
    back = after(RenewCard(card_for("user:ada", 0, since=YEAR).der), RenewCard(card_for("user:ada", 0, since=YEAR / 2).der), roll=roll)
    assert back.card_of("user:ada") == card_for("user:ada", 0, since=YEAR / 2)


NAMES = ("user:ada", "user:bob", NODE)
ENTRIES: st.SearchStrategy[EnrolEntry] = st.one_of(
    st.builds(invite, st.integers(0, 3), st.sampled_from((*NAMES, ANY_NODE))),
    st.builds(enrol, st.integers(0, 3), st.sampled_from(NAMES), st.integers(0, 1)),
    st.builds(lambda number: Withdraw(invitation_key(number).public.raw), st.integers(0, 3)),
    st.builds(lambda name, who: RevokeUser(name, NEWCOMERS[who].signing.key_id), st.sampled_from(NAMES[:2]), st.integers(0, 1)),
    st.builds(lambda trusted: Trust(FIVE, trusted, *((KEY, b"sealed") if trusted else ())), st.booleans()),
    st.builds(lambda name, who: RenewCard(card_for(name, who, since=YEAR).der), st.sampled_from(NAMES), st.integers(0, 1)),
)


@given(st.lists(ENTRIES, max_size=25))
def test_whatever_is_tried_each_invitation_counts_once_and_revoked_keys_never(entries: list[EnrolEntry]) -> None:
    roll, used = Roll(), set[bytes]()
    for entry in entries:
        before = replace(roll)
        try:
            roll = roll.after(entry)
        except Refused:
            continue
        assert before.revoked <= roll.revoked
        if isinstance(entry, Enrol):
            invitation = EnrolForm.decode(entry.form).invitation
            assert invitation not in used
            used.add(invitation)
        for name in NAMES:
            card = roll.card_of(name)
            assert card is None or not roll.is_revoked(name, card.signing_id)
        assert roll.sealed.keys() <= roll.trusted
        open_ones = {key for key, one in roll.invitations.items() if one.state is InvitationState.OPEN}
        assert not open_ones & used
