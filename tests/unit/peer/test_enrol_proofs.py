"""If this fails, members use up invitations that are not theirs, strip nodes of trust, or have orders taken for done that are not; or an
old token admits somebody after its time.
"""

from __future__ import annotations

import datetime
from dataclasses import replace
from functools import partial

import pytest
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, load_der_public_key

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Card
from scenefold.peer.cluster_log.log_rules import check_proposer
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.enrolment.enrol_rules import IssuedBefore
from scenefold.wire import LogEntry, RevokeNode
from scenefold.wire.enrol_entries import ANY_NODE, Enrol, Invite, RenewCard, RevokeUser, Trust
from scenefold.wire.orders import EnrolForm
from scenefold.world.enrol_forms import Wanted, form_in
from scenefold.world.roll import InvitationState
from unit.peer.logs_made import node, record, secrets_of
from unit.peer.members_made import AUTHORITY, NEWCOMERS, NOW, TLS_KEYS, card_for, enrolled, form_for, invitation_key
from unit.peer.test_enrol_rules import CLOCK, FACTS, NEWCOMER, OWNER, form, invite, judged, log, member, ordered
from unit.peer.test_enrol_rules import order as given
from unit.world.test_roll import YEAR

NAME = f"node:{NEWCOMER}"
ADA = "user:ada"
OLD = card_for(NAME, 0)


def committed(registry: Registry, entry: LogEntry, *, now: float = CLOCK) -> Registry:
    """What the voter does with a proposal of some member, and every node with the record."""
    check_proposer(entry, node(1), registry, FACTS, now)
    return registry.apply(record(registry, entry))


def refusal(registry: Registry, entry: LogEntry, *, now: float = CLOCK) -> RejectReason:
    with pytest.raises(Refused) as caught:
        committed(registry, entry, now=now)
    return caught.value.reason


def folded(registry: Registry, entry: LogEntry) -> RejectReason:
    """Why a node does not take this record, whatever a voter has let through."""
    with pytest.raises(Refused) as caught:
        registry.apply(record(registry, entry))
    return caught.value.reason


def reinvited() -> Registry:
    """A node is a member, and trusted; somebody has invited it anew, by name, since its disk is lost."""
    trust = Trust(NEWCOMER, True, NEWCOMERS[0].sealing.public.raw)
    return log(invite(ANY_NODE, 1), enrolled(1, OLD), trust, invite(NAME, 2))


def test_nobody_but_the_holder_of_a_token_uses_it_up() -> None:
    registry = reinvited()
    mine = form_for(OLD, 2)
    for entry in (
        enrolled(2, OLD, by=NEWCOMERS[0].signing),
        enrolled(2, OLD, by=invitation_key(1)),
        replace(enrolled(2, OLD), signature=bytes(64)),
        replace(enrolled(2, OLD, form=replace(mine, tls_key=TLS_KEYS[1])), form=mine.encode()),
        replace(enrolled(2, OLD), signature=enrolled(1, OLD).signature),
    ):
        assert refusal(registry, entry) is folded(registry, entry) is RejectReason.SIGNATURE_INVALID
    assert refusal(registry, enrolled(1, OLD)) is RejectReason.NOT_AUTHORISED, "what was signed once serves once"
    asked = judged(registry, form(NAME, 1, 2, NEWCOMER), key=invitation_key(2))
    assert registry.is_trusted(NEWCOMER) and isinstance(asked, Wanted)


@pytest.mark.parametrize("invited", [ANY_NODE, NAME])
def test_a_stray_certificate_takes_nobodys_invitation(invited: str) -> None:
    registry = log(invite(invited))
    assert refusal(registry, enrolled(1, OLD, by=NEWCOMERS[0].signing)) is RejectReason.SIGNATURE_INVALID
    assert committed(registry, enrolled(1, OLD)).roll.card_of(NAME) == OLD


def other_forms(card: Card) -> list[EnrolForm]:
    """All that differ in one thing from what the card says."""
    mine = form_for(card, 1)
    keys = [NEWCOMERS[1].public().encode(), replace(NEWCOMERS[0].public(), sealing=NEWCOMERS[1].sealing.public).encode()]
    forms = [replace(mine, tls_key=TLS_KEYS[1]), *(replace(mine, keys=other) for other in keys)]
    elsewhere = NodeId(NEWCOMER + 1)
    return [*forms, replace(mine, name=f"node:{elsewhere}", address=elsewhere) if mine.address else replace(mine, name="user:eve")]


@pytest.mark.parametrize(("name", "invited"), [(NAME, ANY_NODE), (NAME, NAME), (ADA, ADA)])
def test_a_card_is_what_the_holder_of_the_token_asked_for(name: str, invited: str) -> None:
    card, registry = card_for(name, 0), log(invite(invited))
    for asked in other_forms(card):
        entry = enrolled(1, card, form=asked)
        assert refusal(registry, entry) is folded(registry, entry) is RejectReason.NOT_AUTHORISED, asked
    assert committed(registry, enrolled(1, card)).roll.card_of(name) == card


def test_who_administers_says_the_invitation_and_neither_form_nor_card() -> None:
    card, bold = card_for(ADA, 0), replace(form_for(card_for(ADA, 0), 1), keys=NEWCOMERS[0].public(is_administrator=True).encode())
    high = card_for(ADA, 0, admin=True)
    for invited, card_given, fits in ((False, card, True), (False, high, False), (True, high, True), (True, card, False)):
        registry = log(invite(ADA, admin=invited))
        entry = enrolled(1, card_given, form=bold)
        if fits:
            assert committed(registry, entry).roll.card_of(ADA) == card_given
        else:
            assert folded(registry, entry) is RejectReason.NOT_AUTHORISED


def _card_at(name: str, *addresses: str) -> Card:
    pem = AUTHORITY.certify(name, list(addresses), TLS_KEYS[0], keys=NEWCOMERS[0].public(), now=NOW)
    return Card.verified(pem, AUTHORITY.certificate)


def test_no_log_holds_a_member_where_none_can_be() -> None:
    nowhere = node_id_of("224.0.0.1")
    users = replace(form_for(card_for(ADA, 0), 1), address=NEWCOMER)
    for invited, entry, reason in (
        (ANY_NODE, enrolled(1, _card_at(f"node:{nowhere}", "224.0.0.1")), RejectReason.ILL_FORMED),
        (ANY_NODE, enrolled(1, OLD, form=replace(form_for(OLD, 1), address=NodeId(NEWCOMER + 1))), RejectReason.ILL_FORMED),
        (ANY_NODE, enrolled(1, OLD, form=replace(form_for(OLD, 1), address=NodeId(0))), RejectReason.ILL_FORMED),
        (ANY_NODE, enrolled(1, OLD, form=replace(form_for(OLD, 1), name="")), RejectReason.NOT_AUTHORISED),
        (ANY_NODE, enrolled(1, _card_at(NAME, "127.0.0.10", "127.0.0.11")), RejectReason.NOT_AUTHORISED),
        (ADA, enrolled(1, card_for(ADA, 0), form=users), RejectReason.ILL_FORMED),
        (ADA, enrolled(1, _card_at(ADA, "127.0.0.10")), RejectReason.NOT_AUTHORISED),
    ):
        assert folded(log(invite(invited)), entry) is reason, form_in(entry.form)


@pytest.mark.parametrize("bad", [b"", b"\x90", b"\xff" * 90, b"x" * 4096])
def test_what_is_no_form_enrols_nobody(bad: bytes) -> None:
    entry = Enrol(bad, bytes(64), OLD.der)
    assert refusal(log(invite(ANY_NODE)), entry) is folded(log(invite(ANY_NODE)), entry) is RejectReason.ILL_FORMED
    keyless = enrolled(1, OLD, form=replace(form_for(OLD, 1), keys=b"none"))
    assert folded(log(invite(ANY_NODE)), keyless) is RejectReason.ILL_FORMED


def test_a_token_ends_by_the_clock_of_the_voter_whoever_has_issued_for_it() -> None:
    ends = invite(ADA).expires
    fresh = card_for(ADA, 0, since=datetime.timedelta(hours=1))
    entry = enrolled(1, fresh)
    assert committed(log(invite(ADA)), entry, now=ends).roll.card_of(ADA) == fresh
    for late in (ends + 1, ends + 5 * 86400):
        with pytest.raises(Refused, match="the token was valid until 2026-03-01 01:00 UTC, and this node's clock says"):
            committed(log(invite(ADA)), entry, now=late)
    # Who folds the log looks at no clock: what was committed in time counts for ever.
    assert log(replace(invite(ADA), expires=1), entry).roll.card_of(ADA) == fresh


def test_who_is_enrolled_anew_is_not_trusted_by_what_it_was() -> None:
    """Whatever its keys: who invites a node by its name need not know which it will come back with."""
    for who in (0, 1):
        back = committed(reinvited(), enrolled(2, card_for(NAME, who)))
        assert not back.is_trusted(NEWCOMER) and NEWCOMER not in back.issuers
        assert back.is_revoked(NEWCOMER, OLD.signing_id) is False and back.roll.is_revoked(NAME, OLD.signing_id) is (who == 1)


def test_a_used_token_serves_its_member_only_while_that_counts() -> None:
    key = NEWCOMERS[0].signing.key_id
    replaced = (invite(NAME, 2), enrolled(2, card_for(NAME, 1)))
    for name, asked, then in (
        (ADA, form(), (RevokeUser(ADA, key),)),
        (NAME, form(NAME, address=NEWCOMER), (RevokeNode(NEWCOMER, key),)),
        (NAME, form(NAME, address=NEWCOMER), replaced),
    ):
        registry = log(*member(name, 0))
        assert isinstance(judged(registry, asked), IssuedBefore)
        with pytest.raises(Refused, match=f"the key of {name} is revoked") as caught:
            judged(log(*member(name, 0), *then), asked)
        assert caught.value.reason is RejectReason.KEY_REVOKED
        with pytest.raises(Refused, match="used already"):
            judged(log(*member(name, 0), *then), replace(asked, tls_key=TLS_KEYS[1]))


def test_an_invitation_is_used_only_by_what_was_committed() -> None:
    registry, key = log(invite(ADA)), invitation_key(1).public.raw
    assert isinstance(registry.roll.invitations[key].entry, Invite)
    assert refusal(registry, enrolled(1, card_for(ADA, 0), by=invitation_key(2))) is RejectReason.SIGNATURE_INVALID
    assert registry.roll.invitations[key].state is InvitationState.OPEN
    assert committed(registry, enrolled(1, card_for(ADA, 0))).roll.invitations[key].state is InvitationState.USED


def test_an_order_is_done_only_if_it_was_committed_and_not_what_a_member_put_in_under_its_id() -> None:
    """Who carries an order to the voter sees its id, and may propose something of its own before it."""
    order = given(RevokeUser(ADA, NEWCOMERS[0].signing.key_id))
    registry = log(*member(ADA, 0))
    quicker = registry.apply(record(registry, RenewCard(card_for(ADA, 0, since=YEAR).der), request=order.request))
    with pytest.raises(Refused, match="another entry has this request's id") as caught:
        ordered(quicker, order)
    assert caught.value.reason is RejectReason.ILL_FORMED
    done = registry.apply(record(registry, order.entry, request=order.request))
    late = replace(order, issued=0)
    assert ordered(done, order) == order and ordered(done, late) == late, "given twice it counts once, however late"


def test_the_only_node_that_can_issue_is_not_invited_anew_for_that_would_end_its_trust() -> None:
    trust = Trust(NEWCOMER, True, NEWCOMERS[0].sealing.public.raw, b"sealed")
    both = log(invite(ANY_NODE, 1), enrolled(1, OLD), trust)
    assert ordered(both, given(invite(NAME, 2)))
    alone = both.apply(record(both, Trust(node(0), False)))
    with pytest.raises(Refused, match="only trusted node"):
        ordered(alone, given(invite(NAME, 2)))
    assert ordered(alone, given(invite(ANY_NODE, 2))), "which takes the place of no node"


def test_somebody_issues_whatever_was_ordered_before_another_order_was_carried_out() -> None:
    trust = Trust(NEWCOMER, True, NEWCOMERS[0].sealing.public.raw, b"sealed")
    invited = log(invite(ANY_NODE, 1), enrolled(1, OLD), trust, invite(NAME, 2), Trust(node(0), False))
    anew = form(NAME, 1, 2, NEWCOMER)
    for refused in (partial(committed, invited, enrolled(2, card_for(NAME, 1))), partial(judged, invited, anew, key=invitation_key(2))):
        with pytest.raises(Refused, match="only trusted node") as caught:
            refused()
        assert caught.value.reason is RejectReason.NOT_AUTHORISED
    for entry in (Trust(NEWCOMER, False), RevokeNode(NEWCOMER, NEWCOMERS[0].signing.key_id)):
        with pytest.raises(Refused, match="only trusted node"):
            check_proposer(entry, node(0), invited, FACTS, CLOCK)
    two = invited.apply(record(invited, Trust(node(0), True, secrets_of(0).sealing.public.raw)))
    assert judged(two, anew, key=invitation_key(2))
    assert committed(two, enrolled(2, card_for(NAME, 1))).issuers == {node(0)}


def test_somebody_administers_whatever_was_ordered_before_another_order_was_carried_out() -> None:
    two = log(invite(ADA, 1, admin=True), enrolled(1, card_for(ADA, 0, admin=True)))
    owner, ada = (RevokeUser(name, card.signing_id) for name, card in (("user:owner", OWNER), (ADA, card_for(ADA, 0, admin=True))))
    for first, second in ((owner, ada), (ada, owner)):
        check_proposer(first, node(0), two, FACTS, CLOCK)
        check_proposer(second, node(0), two, FACTS, CLOCK)
        with pytest.raises(Refused, match="only administrator"):
            check_proposer(second, node(0), two.apply(record(two, first)), FACTS, CLOCK)


P256, P192 = bytes.fromhex("2a8648ce3d030107"), bytes.fromhex("2a8648ce3d030101")
"""Of curves, as certificates name them."""
LARGER = ec.generate_private_key(ec.SECP384R1()).public_key().public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)


def _card_for_key(tls_key: bytes, monkeypatch: pytest.MonkeyPatch) -> bytes:
    """A card for a key that an authority which runs our program certifies none of."""
    monkeypatch.setattr("scenefold.crypto.authority.public_tls_key", load_der_public_key)
    pem = AUTHORITY.certify(ADA, [], tls_key, keys=NEWCOMERS[0].public(), now=NOW)
    return Card.verified(pem, AUTHORITY.certificate).der


def test_a_card_for_a_key_that_tls_here_does_not_know_is_refused_and_ends_no_node(monkeypatch: pytest.MonkeyPatch) -> None:
    registry, good = log(invite(ADA)), enrolled(1, card_for(ADA, 0))
    larger = _card_for_key(LARGER, monkeypatch)
    for card in (good.card.replace(P256, P192), larger):
        assert card != good.card
        assert folded(registry, replace(good, card=card)) is RejectReason.ILL_FORMED
        assert folded(committed(registry, good), RenewCard(card)) is RejectReason.ILL_FORMED
    asked = replace(form_for(card_for(ADA, 0), 1), tls_key=LARGER)
    assert folded(registry, replace(enrolled(1, card_for(ADA, 0), form=asked), card=larger)) is RejectReason.ILL_FORMED
    assert refusal(registry, enrolled(1, card_for(ADA, 0), form=asked)) is RejectReason.ILL_FORMED


@pytest.mark.parametrize(
    "tls_key",
    [LARGER, b"", b"no key", TLS_KEYS[0].replace(P256, P192), TLS_KEYS[0] + b"0"],
    ids=["larger curve", "empty", "no key", "other curve", "one byte more"],
)
def test_a_newcomer_with_a_key_that_tls_here_does_not_know_hears_so(tls_key: bytes) -> None:
    with pytest.raises(Refused, match="TLS key") as caught:
        judged(log(invite(ADA)), replace(form(), tls_key=tls_key))
    assert caught.value.reason is RejectReason.ILL_FORMED
