"""If this fails, a token is misread, believed though it was mistyped, or leads to another cluster than the one that gave it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, UsageFault
from scenefold.base.ids import NodeId
from scenefold.crypto import Authority, InvalidSignature, InvitedKind, Token, authority_der, authority_pem, check_signed, mark_of

U32 = st.integers(0, 2**32 - 1)
TOKENS = st.builds(
    Token,
    kind=st.sampled_from(InvitedKind),
    seed=st.binary(min_size=32, max_size=32),
    mark=st.binary(min_size=16, max_size=16),
    expires=U32,
    low=st.integers(1, 65535),
    high=st.integers(1, 65535),
    addresses=st.lists(U32.map(NodeId), max_size=3).map(tuple),
)
AUTHORITY = Authority.create("studio")


@given(TOKENS)
def test_a_token_says_what_it_was_made_with(token: Token) -> None:
    word = token.word()
    assert Token.read(word) == token
    assert Token.read(f"  {word.upper().replace('-', ' ')}\n") == token, "people copy words in their own ways"
    assert word.isascii() and all(len(group) <= 8 for group in word.split("-"))


@given(TOKENS, st.data())
def test_a_mistyped_letter_is_noticed(token: Token, data: st.DataObject) -> None:
    word = token.word().replace("-", "")
    at = data.draw(st.integers(0, len(word) - 1))
    letter = data.draw(st.sampled_from("abcdefghijklmnopqrstuvwxyz234567"))
    bent = word[:at] + letter + word[at + 1 :]
    if bent != word:
        with pytest.raises(UsageFault):
            Token.read(bent)


@given(TOKENS, st.data())
def test_a_token_that_was_cut_off_is_noticed(token: Token, data: st.DataObject) -> None:
    word = token.word()
    part = word[: data.draw(st.integers(0, len(word) - 1))]
    with pytest.raises(UsageFault, match="token"):
        Token.read(part)


@given(st.text(max_size=600))
def test_what_is_no_token_is_told_so(text: str) -> None:
    with pytest.raises(UsageFault, match="token"):
        Token.read(text)


def test_the_seed_is_in_no_repr() -> None:
    token = Token(InvitedKind.NODE, b"s" * 32, bytes(16), 0, 1, 2, ())
    assert "ssss" not in repr(token) and (b"s" * 32).hex() not in repr(token)


def test_a_mark_is_that_of_one_authority_in_either_form() -> None:
    der = authority_der(AUTHORITY.certificate)
    assert mark_of(AUTHORITY.certificate) == mark_of(der) == mark_of(authority_pem(der)) and len(mark_of(der)) == 16
    assert mark_of(Authority.create("studio").certificate) != mark_of(der)
    with pytest.raises(DamagedData):
        mark_of(b"-----BEGIN CERTIFICATE-----\n")


def test_only_the_authority_signs_for_the_authority_and_for_one_purpose() -> None:
    signature = AUTHORITY.sign(b"scenefold/charter", b"message")
    check_signed(AUTHORITY.certificate, signature, b"scenefold/charter", b"message")
    for certificate, domain, message in (
        (Authority.create("studio").certificate, b"scenefold/charter", b"message"),
        (AUTHORITY.certificate, b"scenefold/other", b"message"),
        (AUTHORITY.certificate, b"scenefold/charter", b"Message"),
    ):
        with pytest.raises(InvalidSignature):
            check_signed(certificate, signature, domain, message)


def test_an_authority_is_made_of_its_key_again() -> None:
    again = Authority.from_key(AUTHORITY.certificate, AUTHORITY.key_der())
    check_signed(AUTHORITY.certificate, again.sign(b"scenefold/charter", b"m"), b"scenefold/charter", b"m")
    with pytest.raises(DamagedData, match="another authority"):
        Authority.from_key(AUTHORITY.certificate, Authority.create("studio").key_der())
    with pytest.raises(DamagedData):
        Authority.from_key(AUTHORITY.certificate, b"no key")
