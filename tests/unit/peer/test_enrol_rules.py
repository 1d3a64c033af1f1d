"""If this fails, a node issues a certificate to whom nobody invited, or carries out an order that no administrator gave."""

from __future__ import annotations

import datetime
from collections.abc import Iterable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import KeyId, NodeId, address_of, node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.crypto import ENROL_DOMAIN, ORDER_DOMAIN, Authority, Card, SigningKey
from scenefold.peer.cluster_log.log_rules import check_proposer
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.enrolment.card_rules import (
    check_issued,
    check_renewable,
    credential_of,
    is_administrator,
    is_user_key,
    not_due,
    refusal_of,
)
from scenefold.peer.enrolment.enrol_rules import ORDER_S_MAX, IssuedBefore, judge_form, judge_order
from scenefold.wire import AddNode, LogEntry, MalformedPacket, Member, RemoveNode, RevokeNode
from scenefold.wire.enrol_entries import ANY_NODE, Invite, RenewCard, RevokeUser, Trust, Withdraw
from scenefold.wire.log_entries import SingleEntry
from scenefold.wire.orders import EnrolForm, Order
from scenefold.world.enrol_forms import Wanted
from scenefold.world.facts import ClusterFacts
from unit.peer import logs_made
from unit.peer.logs_made import add, found, key_of, node, record, secrets_of
from unit.peer.members_made import AUTHORITY, NEWCOMERS, NOW, TLS_KEYS, card_for, enrolled, invitation_key
from unit.peer.voters_made import dismissed, named, trusted

DAY = datetime.timedelta(days=1)
OWNER = card_for("user:owner", 2, admin=True)
FACTS = replace(logs_made.facts(2), authority=AUTHORITY.certificate, owners=(OWNER.der,))
CLOCK = NOW.timestamp() + 60
NEWCOMER = node_id_of("127.0.0.10")


def log(*entries: LogEntry) -> Registry:
    registry = Registry()
    for entry in (found(2), add(0), add(1), *entries):
        registry = registry.apply(record(registry, entry))
    return registry


TRUST = Trust(node(1), True, secrets_of(1).sealing.public.raw)


def invite(name: str, number: int = 1, *, admin: bool = False, by: str = "user:owner") -> Invite:
    return Invite(invitation_key(number).public.raw, name, admin, int(NOW.timestamp()) + 3600, by)


def form(name: str = "", who: int = 0, number: int = 1, address: int = 0) -> EnrolForm:
    return EnrolForm(invitation_key(number).public.raw, name, NodeId(address), TLS_KEYS[who], NEWCOMERS[who].public().encode())


def judged(registry: Registry, asked: EnrolForm, *, key: SigningKey | None = None, now: float = CLOCK) -> Wanted | IssuedBefore:
    data = asked.encode()
    return judge_form(data, (key or invitation_key(1)).sign(ENROL_DOMAIN, data), registry, FACTS, now)


def refusal_text(registry: Registry, asked: EnrolForm, **how: float) -> str:
    with pytest.raises(Refused) as caught:
        judged(registry, asked, **how)  # type: ignore[arg-type]
    return str(caught.value)


def test_only_administrators_may_give_orders_to_nodes() -> None:
    registry = log(*member("user:ada", 0, admin=True), *member("user:eve", 1, number=2))
    assert [is_administrator(user, registry, FACTS) for user in ("user:owner", "user:ada", "user:eve", "user:nobody")] == [
        True,
        True,
        False,
        False,
    ]
    gone = registry.apply(record(registry, RevokeUser("user:ada", NEWCOMERS[0].signing.key_id)))
    assert not is_administrator("user:ada", gone, FACTS)
    assert is_administrator("user:anybody", registry, replace(FACTS, authority=b""))


def test_an_invited_user_gets_the_name_and_the_rights_that_the_invitation_gives() -> None:
    for admin in (False, True):
        issue = judged(log(invite("user:ada", admin=admin)), form())
        assert isinstance(issue, Wanted)
        assert (issue.name, issue.addresses, issue.keys) == ("user:ada", (), NEWCOMERS[0].public(is_administrator=admin))


def test_a_node_that_calls_itself_administrator_is_none() -> None:
    bold = replace(form(), keys=NEWCOMERS[0].public(is_administrator=True).encode())
    issue = judged(log(invite("user:ada")), bold)
    assert isinstance(issue, Wanted) and not issue.keys.is_administrator


def test_who_asks_again_with_the_same_keys_gets_the_same_card_and_nobody_else_does() -> None:
    card = card_for("user:ada", 0)
    registry = log(invite("user:ada"), enrolled(1, card))
    again = judged(registry, form())
    assert isinstance(again, IssuedBefore) and again.card == card
    assert isinstance(judged(registry, form("user:ada"), now=CLOCK + 10**7), IssuedBefore), "what was issued is no secret, however late"
    for other in (form(who=1), replace(form(), tls_key=TLS_KEYS[1]), form("user:eve")):
        assert "used already" in refusal_text(registry, other)


def test_each_refusal_says_its_own_reason() -> None:
    registry = log(invite("user:ada"))
    assert "no such token" in refusal_text(registry, form(number=2))
    assert "valid until 2026-03-01 01:00 UTC, and this node's clock says 2026-03-01 01:06" in refusal_text(
        registry, form(), now=CLOCK + 3900
    )
    assert "for user:ada, not for user:eve" in refusal_text(registry, form("user:eve"))
    assert "withdrawn" in refusal_text(log(invite("user:ada"), Withdraw(invitation_key(1).public.raw)), form())
    with pytest.raises(Refused) as caught:
        judged(registry, form(), key=invitation_key(2))
    assert caught.value.reason == RejectReason.SIGNATURE_INVALID


def test_a_node_gets_a_card_for_its_own_address_only() -> None:
    registry = log(invite(ANY_NODE))
    issue = judged(registry, form(f"node:{NEWCOMER}", address=NEWCOMER))
    assert isinstance(issue, Wanted) and issue.addresses == (address_of(NEWCOMER),)
    assert "cannot be at" in refusal_text(registry, form(f"node:{NEWCOMER}", address=NEWCOMER + 1))
    assert "from the start" in refusal_text(registry, form(f"node:{node(1)}", address=node(1)))
    assert "for a node, not for user:ada" in refusal_text(registry, form("user:ada"))


@pytest.mark.parametrize("number", ["0{}", "00{}", "+{}", "{}0000000000"])
def test_a_node_has_one_name(number: str) -> None:
    name = "node:" + number.format(NEWCOMER)
    with pytest.raises(Refused):
        judged(log(invite(ANY_NODE)), form(name, address=NEWCOMER))
    with pytest.raises(LocalFault):
        AUTHORITY.certify(name, [address_of(NEWCOMER)], TLS_KEYS[0], keys=NEWCOMERS[0].public(), now=NOW)


@pytest.mark.parametrize("address", ["0.0.0.0", "0.0.0.7", "224.0.0.1", "239.255.255.255", "255.255.255.255"])
def test_no_node_is_enrolled_where_no_machine_is(address: str) -> None:
    node_id = node_id_of(address)
    registry = log(invite(ANY_NODE))
    assert "not the address of one machine" in refusal_text(registry, form(f"node:{node_id}", address=node_id))
    with pytest.raises(Refused, match="not the address of one machine"):
        check_issued(enrolled(1, card_for(f"node:{node_id}", 0)), registry, FACTS, CLOCK)


@pytest.mark.parametrize("addresses", [[], ["127.0.0.11"], ["127.0.0.10", "127.0.0.11"]])
def test_a_node_whose_card_says_another_address_never_gets_into_the_log(addresses: list[str]) -> None:
    pem = AUTHORITY.certify(f"node:{NEWCOMER}", addresses, TLS_KEYS[0], keys=NEWCOMERS[0].public(), now=NOW)
    with pytest.raises(Refused, match="cannot be at"):
        check_issued(enrolled(1, Card.verified(pem, AUTHORITY.certificate)), log(invite(ANY_NODE)), FACTS, CLOCK)


FORM = form().encode()
SIGNATURE = invitation_key(1).sign(ENROL_DOMAIN, FORM)


@given(st.integers(0, 8 * len(FORM) - 1))
def test_no_flipped_bit_of_a_request_is_overlooked(bit: int) -> None:
    bent = bytearray(FORM)
    bent[bit // 8] ^= 1 << bit % 8
    with pytest.raises((Refused, MalformedPacket)):
        judge_form(bytes(bent), SIGNATURE, log(invite("user:ada")), FACTS, CLOCK)


# ---------------------------------------------------------------------------------------------------------------- orders


def order(entry: SingleEntry, by: str = "user:owner", *, issued: float = CLOCK, cluster: bytes = FACTS.cluster_id) -> Order:
    return Order(cluster, b"r" * 16, by, int(issued), entry)


def ordered(registry: Registry, what: Order, who: int = 2) -> Order:
    data = what.encode()
    return judge_order(data, NEWCOMERS[who].signing.sign(ORDER_DOMAIN, data), registry, FACTS, CLOCK)


def forbidden(registry: Registry, what: Order, who: int = 2) -> str:
    with pytest.raises(Refused) as caught:
        ordered(registry, what, who)
    assert caught.value.reason in (RejectReason.NOT_AUTHORISED, RejectReason.SIGNATURE_INVALID, RejectReason.ILL_FORMED)
    return str(caught.value)


def member(name: str, who: int, number: int = 1, *, admin: bool = False) -> Iterable[LogEntry]:
    return invite(name, number, admin=admin), enrolled(number, card_for(name, who, admin=admin))


def test_only_an_administrators_own_key_gives_orders() -> None:
    registry = log(*member("user:ada", 0), *member("user:bob", 1, 2, admin=True))
    assert ordered(registry, order(invite("user:eve", 3))).entry == invite("user:eve", 3)
    assert ordered(registry, order(invite("user:eve", 3, by="user:bob"), "user:bob"), 1)
    assert "no administrator" in forbidden(registry, order(invite("user:eve", 3, by="user:ada"), "user:ada"), 0)
    assert "no administrator" in forbidden(registry, order(invite("user:eve", 3, by="user:eve"), "user:eve"), 0)
    assert "signature" in forbidden(registry, order(invite("user:eve", 3)), 1)
    assert "who gave it" in forbidden(registry, order(invite("user:eve", 3, by="user:bob")))
    assert "another cluster" in forbidden(registry, order(invite("user:eve", 3), cluster=b"c" * 16))


def test_no_invitation_is_open_for_ever() -> None:
    for days, fits in ((30, True), (31, False), (10_000, False)):
        entry = replace(invite("user:eve"), expires=int(CLOCK + days * DAY.total_seconds()))
        if fits:
            assert ordered(log(), order(entry))
        else:
            assert "30 days" in forbidden(log(), order(entry))


def test_an_order_counts_for_an_hour_by_any_clock() -> None:
    for off in (-ORDER_S_MAX, ORDER_S_MAX):
        assert ordered(log(), order(invite("user:eve"), issued=CLOCK + off))
        assert "out of date" in forbidden(log(), order(invite("user:eve"), issued=CLOCK + 1.01 * off))


def test_a_revoked_administrator_orders_nothing_any_more() -> None:
    registry = log(*member("user:bob", 1, admin=True), RevokeUser("user:owner", OWNER.signing_id))
    assert "no administrator" in forbidden(registry, order(invite("user:eve", 3)))
    assert ordered(registry, order(invite("user:eve", 3, by="user:bob"), "user:bob"), 1)


def test_the_cluster_keeps_an_administrator_its_voter_and_a_trusted_node() -> None:
    registry = log(*member("user:ada", 0))
    assert "only administrator" in forbidden(registry, order(RevokeUser("user:owner", OWNER.signing_id)))
    assert ordered(registry, order(RevokeUser("user:ada", NEWCOMERS[0].signing.key_id)))
    assert "no member with such a key" in forbidden(registry, order(RevokeUser("user:ada", NEWCOMERS[1].signing.key_id)))
    assert "decides the cluster's log" in forbidden(registry, order(RevokeNode(node(0), key_of(0).key_id)))
    assert ordered(registry, order(RevokeNode(node(1), key_of(1).key_id)))
    assert "only trusted node" in forbidden(registry, order(Trust(node(0), False)))
    assert ordered(registry, order(TRUST))
    assert "no node of this cluster" in forbidden(registry, order(replace(TRUST, node=NEWCOMER)))
    known = registry.current(node(1))
    assert known is not None
    assert "leaves by itself" in forbidden(registry, order(RemoveNode(known.member, "out")))
    assert ordered(log(RevokeNode(node(1), key_of(1).key_id)), order(RemoveNode(known.member, "its key was revoked")))


def test_trust_in_the_last_node_that_has_the_authoritys_key_cannot_be_withdrawn() -> None:
    with pytest.raises(Refused, match="wait until it was sealed to") as caught:
        ordered(log(TRUST), order(Trust(node(0), False)))
    assert caught.value.reason is RejectReason.NOT_READY, "nobody could seal the key to it any more"
    both = log(TRUST, replace(TRUST, sealed=b"sealed"))
    assert ordered(both, order(Trust(node(0), False)))
    gone = both.apply(record(both, RemoveNode(add(1).member, "drained")))
    assert "only trusted node" in forbidden(gone, order(Trust(node(0), False))), "who has left the line helps nobody"
    other = log(TRUST, replace(TRUST, sealed=b"sealed"), Trust(node(0), False))
    for entry in (Trust(node(1), False), RevokeNode(node(1), key_of(1).key_id)):
        assert "only trusted node" in forbidden(other, order(entry))


def test_an_order_to_trust_names_the_key_that_the_node_has() -> None:
    swapped = replace(TRUST, sealing_key=NEWCOMERS[0].sealing.public.raw)
    assert "another key" in forbidden(log(), order(swapped))
    assert "another key" in forbidden(log(), order(replace(swapped, sealed=b"sealed")))


@pytest.mark.parametrize("entry", [add(1), found(2), enrolled(1, card_for("user:ada", 0))])
def test_what_nobody_orders_is_refused(entry: SingleEntry) -> None:
    assert "nobody orders" in forbidden(log(), order(entry))


# ----------------------------------------------------------------------------------------------------------------- cards


def test_a_card_of_another_authority_never_gets_into_the_log() -> None:
    other = Authority.create("studio", now=NOW).certify("user:ada", [], TLS_KEYS[0], keys=NEWCOMERS[0].public(), now=NOW)
    for entry in (replace(enrolled(1, card_for("user:ada", 0)), card=other), RenewCard(other), RenewCard(b"none")):
        with pytest.raises(Refused) as caught:
            check_issued(entry, log(invite("user:ada")), FACTS, CLOCK)
        assert caught.value.reason == RejectReason.SIGNATURE_INVALID
    check_issued(enrolled(1, card_for("user:ada", 0)), log(invite("user:ada")), FACTS, CLOCK)
    with pytest.raises(Refused):
        check_issued(enrolled(1, card_for("user:owner", 0)), log(), FACTS, CLOCK)
    with pytest.raises(Refused):
        check_issued(RenewCard(card_for("user:owner", 0).der), log(), FACTS, CLOCK)
    check_issued(RenewCard(card_for("user:owner", 2, admin=True, since=DAY / 2).der), log(), FACTS, CLOCK)


@pytest.mark.parametrize("since", [2 * DAY, 60 * DAY, -366 * DAY])
def test_a_card_that_does_not_count_today_by_the_voters_clock_never_gets_into_the_log(since: datetime.timedelta) -> None:
    card = card_for("user:ada", 0, since=since)
    for entry, registry in (
        (enrolled(1, card), log(invite("user:ada"))),
        (RenewCard(card.der), log(*member("user:ada", 0))),
    ):
        with pytest.raises(Refused, match="this clock says 2026-03-01"):
            check_issued(entry, registry, FACTS, CLOCK)


def test_no_card_counts_for_more_than_a_year(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenefold.crypto.authority.LEAF_DAYS", 367)
    card = Card.verified(AUTHORITY.certify("user:ada", [], TLS_KEYS[0], keys=NEWCOMERS[0].public(), now=NOW), AUTHORITY.certificate)
    with pytest.raises(Refused, match="for more than a year"):
        check_issued(enrolled(1, card), log(invite("user:ada")), FACTS, CLOCK)


def test_an_older_card_comes_back_only_in_place_of_one_that_does_not_count_today() -> None:
    registry = log(*member("user:ada", 0))
    old, later = card_for("user:ada", 0, since=-30 * DAY), card_for("user:ada", 0, since=DAY / 2)
    check_issued(RenewCard(later.der), registry, FACTS, CLOCK)
    for asked, then in ((old, registry), (card_for("user:owner", 2, admin=True, since=-30 * DAY), log())):
        with pytest.raises(Refused, match="no newer one"):
            check_issued(RenewCard(asked.der), then, FACTS, CLOCK)
    ahead = registry.apply(record(registry, RenewCard(card_for("user:ada", 0, since=300 * DAY).der)))
    check_issued(RenewCard(later.der), ahead, FACTS, CLOCK)


def test_an_enrolled_node_registers_with_its_own_keys_and_a_stranger_not_at_all() -> None:
    name = f"node:{NEWCOMER}"
    registry = log(*member(name, 0))
    keys = NEWCOMERS[0].public()

    def entry(signing: bytes, sealing: bytes) -> AddNode:
        return AddNode(Member(NEWCOMER, b"i" * 16), signing, sealing, address_of(NEWCOMER), node(0))

    check_proposer(entry(keys.signing.raw, keys.sealing.raw), NEWCOMER, registry, FACTS, CLOCK)
    for registry_then, bad in (
        (registry, entry(NEWCOMERS[1].signing.public.raw, keys.sealing.raw)),
        (registry, entry(keys.signing.raw, NEWCOMERS[1].sealing.public.raw)),
        (log(), entry(keys.signing.raw, keys.sealing.raw)),
        (registry.apply(record(registry, RevokeNode(NEWCOMER, keys.signing.key_id))), entry(keys.signing.raw, keys.sealing.raw)),
    ):
        with pytest.raises(Refused) as caught:
            check_proposer(bad, NEWCOMER, registry_then, FACTS, CLOCK)
        assert caught.value.reason == RejectReason.NOT_AUTHORISED
    known = credential_of(NEWCOMER, registry, FACTS)
    assert known is not None and known.sealing_key == keys.sealing


def test_a_certificate_is_renewed_for_its_holder_and_while_its_keys_count() -> None:
    card = card_for("user:ada", 0)
    registry = log(*member("user:ada", 0))
    assert check_renewable(card.der, "user:ada", registry, FACTS) == card
    assert check_renewable(OWNER.der, "user:owner", registry, FACTS) == OWNER
    revoked = registry.apply(record(registry, RevokeUser("user:ada", card.signing_id)))
    for asked, peer, then in ((card, "user:eve", registry), (card, "user:ada", revoked), (card_for("user:ada", 1), "user:ada", registry)):
        with pytest.raises(Refused):
            check_renewable(asked.der, peer, then, FACTS)


def test_nothing_is_issued_anew_before_it_is_due() -> None:
    first = card_for("user:ada", 0)
    registry = log(invite("user:ada"), enrolled(1, first))
    due = first.renew_from.timestamp()
    assert not_due(first, registry, FACTS, due - 1) == first
    assert not_due(first, registry, FACTS, due + 1) is None
    second = card_for("user:ada", 0, since=300 * DAY)
    later = registry.apply(record(registry, RenewCard(second.der)))
    now = (NOW + 300 * DAY).timestamp()
    assert not_due(first, later, FACTS, now) == second, "the answer to the first request was lost"
    assert not_due(first, later, FACTS, CLOCK) == first, "what a wrong clock dated does not count"
    of_founder = card_for(f"node:{node(1)}", 1)
    assert not_due(of_founder, registry, FACTS, CLOCK) == of_founder, "the log has no card of it"


def refused(name: str, key: KeyId | None, registry: Registry, facts: ClusterFacts = FACTS) -> RejectReason | None:
    refusal = refusal_of(name, key, registry, facts)
    return None if refusal is None else refusal.reason


def test_a_peer_is_judged_by_the_key_in_its_certificate() -> None:
    registry = log(
        RevokeNode(node(1), key_of(1).key_id),
        *member("user:ada", 0),
        RevokeUser("user:ada", NEWCOMERS[0].signing.key_id),
        invite("user:ada", 2),
    )
    back = registry.apply(record(registry, enrolled(2, card_for("user:ada", 1))))
    for name, key, then, reason in (
        ("user:owner", OWNER.signing_id, registry, None),
        ("user:ada", NEWCOMERS[0].signing.key_id, registry, RejectReason.KEY_REVOKED),
        ("user:ada", NEWCOMERS[1].signing.key_id, registry, RejectReason.NOT_READY),
        ("user:ada", NEWCOMERS[1].signing.key_id, back, None),
        ("user:ada", NEWCOMERS[0].signing.key_id, back, RejectReason.KEY_REVOKED),
        ("user:ada", None, back, RejectReason.NOT_READY),
        (f"node:{node(1)}", key_of(1).key_id, registry, RejectReason.KEY_REVOKED),
        (f"node:{node(1)}", None, registry, RejectReason.KEY_REVOKED),
        (f"node:{node(0)}", key_of(0).key_id, registry, None),
        (f"node:{node(0)}", key_of(7).key_id, registry, RejectReason.NOT_READY),
        (f"node:{node(0)}", None, registry, RejectReason.NOT_READY),
    ):
        assert refused(name, key, then) is reason, (name, key)


def test_who_is_in_no_log_is_not_let_in() -> None:
    assert refused("user:ghost", NEWCOMERS[0].signing.key_id, log()) is RejectReason.NOT_READY
    assert refused("user:owner", NEWCOMERS[0].signing.key_id, log()) is RejectReason.NOT_READY, "the owner has another key"
    assert refused(f"node:{NEWCOMER}", NEWCOMERS[0].signing.key_id, log()) is None, "nodes may know of it before us; it is no member yet"
    assert refused(f"node:{NEWCOMER}", NEWCOMERS[1].signing.key_id, log(*member(f"node:{NEWCOMER}", 0))) is RejectReason.NOT_READY


def test_a_cluster_without_an_authority_has_no_cards_to_go_by() -> None:
    for name in ("user:ada", f"node:{node(0)}"):
        assert refused(name, None, log(), logs_made.facts(2)) is None


def test_the_keys_of_users_are_those_of_the_log_and_of_the_first_owner_until_they_are_revoked() -> None:
    ada, owner = card_for("user:ada", 0), OWNER.keys.signing
    registry = log(*member("user:ada", 0))
    assert is_user_key(ada.keys.signing, registry, FACTS) and is_user_key(owner, registry, FACTS)
    assert not is_user_key(key_of(1).public, registry, FACTS), "a node's"
    assert not is_user_key(NEWCOMERS[1].signing.public, registry, FACTS), "a stranger's"
    revoked = log(*member("user:ada", 0), RevokeUser("user:ada", ada.signing_id))
    assert not is_user_key(ada.keys.signing, revoked, FACTS)
    assert is_user_key(NEWCOMERS[1].signing.public, registry, replace(FACTS, authority=b"")), "without an authority nobody can tell"


def voting(count: int, *, nodes: int = 9) -> Registry:
    """So many voters, of nodes that are all trusted but the last."""
    registry = Registry()
    for number, entry in enumerate((found(nodes), *map(add, range(nodes)), *map(trusted, range(nodes - 1)), *map(named, range(count)))):
        registry = registry.apply(record(registry, entry, b"%016d" % number))
    return registry


def test_who_decides_the_log_is_ordered_in_words_that_say_what_cannot_be() -> None:
    three = voting(3)
    assert ordered(three, order(named(3))) and ordered(three, order(dismissed(0))) and ordered(voting(0), order(named(0)))
    cases = [
        (three, named(8), "not trusted", RejectReason.NOT_AUTHORISED),
        (three, named(0), "is a voter already", RejectReason.ILL_FORMED),
        (three, named(3, life=1), "no member under this incarnation", RejectReason.WRONG_INCARNATION),
        (three, dismissed(5), "is no voter", RejectReason.ILL_FORMED),
        (voting(7), named(7), "7 voters already", RejectReason.LIMIT_EXCEEDED),
        (voting(1), dismissed(0), "last voter stays", RejectReason.NOT_AUTHORISED),
        (voting(0), dismissed(0), "last voter stays", RejectReason.NOT_AUTHORISED),
        (voting(0), named(1), "first voter that is named", RejectReason.ILL_FORMED),
    ]
    for registry, entry, words, reason in cases:
        with pytest.raises(Refused, match=words) as caught:
            ordered(registry, order(entry))
        assert caught.value.reason is reason
        assert words != "last voter stays" or "cluster add-voter" in caught.value.remedy
    assert "remove-voter 127.0.0.2" in forbidden(three, order(RevokeNode(node(0), key_of(0).key_id)))
