"""A card is believed if our authority signed it, and says what it was issued with."""

from __future__ import annotations

import datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData
from scenefold.crypto import (
    Authority,
    Card,
    Identity,
    MemberKeys,
    NotOfThisCluster,
    OutOfDate,
    SealingKey,
    SigningKey,
    new_tls_key,
    tls_key_in,
)

NOW = datetime.datetime(2026, 3, 1, tzinfo=datetime.UTC)
AUTHORITY = Authority.create("studio", now=NOW)
TLS_KEY = tls_key_in(new_tls_key())
KEYS = MemberKeys(SigningKey(bytes(32)).public, SealingKey(bytes(range(32))).public, is_administrator=True)


def _issued(name: str = "user:ada", addresses: tuple[str, ...] = (), keys: MemberKeys | None = KEYS) -> Identity:
    return AUTHORITY.issue(name, list(addresses), keys=keys, now=NOW)


@pytest.mark.parametrize("is_administrator", [False, True])
def test_a_card_says_what_it_was_issued_with(is_administrator: bool) -> None:
    keys = MemberKeys(KEYS.signing, KEYS.sealing, is_administrator)
    card = Card.verified(_issued("node:3232235777", ("192.168.1.1",), keys).certificate, AUTHORITY.certificate, NOW)
    assert (card.name, card.addresses, card.keys) == ("node:3232235777", ("192.168.1.1",), keys)
    assert card.signing_id == KEYS.signing.key_id
    assert Card.verified(card.der, AUTHORITY.certificate, NOW) == card


def test_a_card_of_another_cluster_is_refused_even_if_it_has_our_name() -> None:
    other = Authority.create("studio", now=NOW)
    with pytest.raises(NotOfThisCluster):
        Card.verified(other.issue("user:ada", [], keys=KEYS, now=NOW).certificate, AUTHORITY.certificate, NOW)


def test_a_clock_that_is_a_year_off_is_named() -> None:
    certificate = _issued().certificate
    year = datetime.timedelta(days=366)
    with pytest.raises(OutOfDate, match=r"valid until 2027-03-01, and this clock says 2027-03-02.*scenectl cluster renew"):
        Card.verified(certificate, AUTHORITY.certificate, NOW + year)
    with pytest.raises(OutOfDate, match=r"valid from 2026-02-28, and this clock says 2025-02-28.*set the clock right"):
        Card.verified(certificate, AUTHORITY.certificate, NOW - year)
    assert Card.verified(certificate, AUTHORITY.certificate, None).name == "user:ada"


DAY = datetime.timedelta(days=1)


def _card(since: datetime.timedelta) -> Card:
    return Card.verified(AUTHORITY.certify("user:ada", [], TLS_KEY, keys=KEYS, now=NOW + since), AUTHORITY.certificate)


def test_a_certificate_that_does_not_count_today_never_replaces_one() -> None:
    mine = _card(0 * DAY)
    newer = _card(250 * DAY)
    assert mine.check_renewed(newer.der, AUTHORITY.certificate, NOW + 250 * DAY) == newer
    for since in (2 * DAY, 60 * DAY, 300 * DAY, -400 * DAY):
        with pytest.raises(OutOfDate):
            mine.check_renewed(_card(since).der, AUTHORITY.certificate, NOW)
    with pytest.raises(DamagedData, match="no newer one"):
        mine.check_renewed(_card(-10 * DAY).der, AUTHORITY.certificate, NOW)


def test_a_certificate_from_a_wrong_clock_is_replaced_by_a_right_one() -> None:
    right = _card(0 * DAY)
    assert _card(300 * DAY).check_renewed(right.der, AUTHORITY.certificate, NOW) == right


@pytest.mark.filterwarnings("ignore:Parsed a serial number")
def test_any_flipped_bit_is_refused() -> None:
    der = Card.verified(_issued().certificate, AUTHORITY.certificate).der
    for bit in range(8 * len(der)):
        flipped = bytearray(der)
        flipped[bit // 8] ^= 1 << bit % 8
        with pytest.raises(DamagedData):
            Card.verified(bytes(flipped), AUTHORITY.certificate)


def test_a_certificate_without_keys_is_no_card() -> None:
    with pytest.raises(DamagedData, match="no member's keys"):
        Card.verified(_issued(keys=None).certificate, AUTHORITY.certificate)
    with pytest.raises(DamagedData, match="names no member"):
        Card.verified(AUTHORITY.certificate, AUTHORITY.certificate)


@given(st.binary(max_size=200))
def test_keys_decode_or_raise_the_one_exception(data: bytes) -> None:
    try:
        keys = MemberKeys.decode(data)
    except DamagedData:
        return
    assert keys.encode() == data


@given(st.binary(max_size=64))
def test_what_is_no_certificate_is_damaged(data: bytes) -> None:
    with pytest.raises(DamagedData):
        Card.verified(data, AUTHORITY.certificate)


def test_a_key_that_is_not_of_p256_is_not_certified() -> None:
    with pytest.raises(DamagedData, match="is no key"):
        AUTHORITY.certify("user:ada", [], b"no key", keys=KEYS)
