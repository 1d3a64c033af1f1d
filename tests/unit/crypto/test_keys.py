"""If this fails, a signature made for one purpose passes for another, or a key cannot be found again."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from hypothesis import given
from hypothesis import strategies as st
from nacl.bindings import crypto_scalarmult_ed25519_base_noclamp

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.crypto import HEADER_DOMAIN, RECORD_DOMAIN, InvalidSignature, PublicKey, SigningKey, key_id_of
from scenefold.crypto.keys import signed_bytes

KEY = SigningKey.from_seed(bytes(range(32)))
DOMAINS = st.binary(min_size=1, max_size=40)


@given(DOMAINS, st.binary(max_size=100))
def test_what_was_signed_verifies(domain: bytes, message: bytes) -> None:
    KEY.public.verify(KEY.sign(domain, message), domain, message)


@given(DOMAINS, st.binary(max_size=40), DOMAINS, st.binary(max_size=40))
def test_nothing_else_verifies(domain: bytes, message: bytes, other_domain: bytes, other_message: bytes) -> None:
    if (domain, message) != (other_domain, other_message):
        with pytest.raises(InvalidSignature):
            KEY.public.verify(KEY.sign(domain, message), other_domain, other_message)


def test_moving_bytes_between_domain_and_message_is_noticed() -> None:
    signature = KEY.sign(b"scenefold/header", b"x")
    with pytest.raises(InvalidSignature):
        KEY.public.verify(signature, b"scenefold/heade", b"rx")


@pytest.mark.parametrize("signature", [b"", bytes(63), bytes(64), bytes(65), b"\xff" * 64])
def test_no_signature_at_all(signature: bytes) -> None:
    with pytest.raises(InvalidSignature):
        KEY.public.verify(signature, RECORD_DOMAIN, b"message")


def test_another_key() -> None:
    with pytest.raises(InvalidSignature, match="not that of key"):
        SigningKey.generate().public.verify(KEY.sign(HEADER_DOMAIN, b""), HEADER_DOMAIN, b"")


@pytest.mark.parametrize("raw", [b"\x01" + bytes(31), bytes(32), b"\xec" + b"\xff" * 30 + b"\x7f"])
def test_a_key_of_small_order_signs_nothing(raw: bytes) -> None:
    """For the first of these the identity as R and a scalar of zero satisfy the equation, whatever the message is."""
    with pytest.raises(InvalidSignature):
        PublicKey(raw).verify(b"\x01" + bytes(63), RECORD_DOMAIN, b"message")


def test_a_signature_of_small_order_is_none() -> None:
    """A good key, and R the identity: with S = h * a it satisfies the equation, so OpenSSL takes it."""
    order, digest = 2**252 + 27742317777372353535851937790883648493, hashlib.sha512
    secret = bytearray(digest(KEY.seed).digest()[:32])
    secret[0], secret[31] = secret[0] & 248, secret[31] & 127 | 64
    point, message = b"\x01" + bytes(31), b"message"
    challenge = int.from_bytes(digest(point + KEY.public.raw + signed_bytes(RECORD_DOMAIN, message)).digest(), "little") % order
    signature = point + (challenge * int.from_bytes(secret, "little") % order).to_bytes(32, "little")
    Ed25519PublicKey.from_public_bytes(KEY.public.raw).verify(signature, signed_bytes(RECORD_DOMAIN, message))
    with pytest.raises(InvalidSignature):
        KEY.public.verify(signature, RECORD_DOMAIN, message)


@pytest.mark.parametrize("raw", [b"\x01" + bytes(31), bytes(32)])
def test_a_key_of_small_order_signs_nothing_with_a_point_of_large_order_either(raw: bytes) -> None:
    """With R = S * B it satisfies the equation for the first of these, and for one message of four for the other."""
    scalar = int.from_bytes(hashlib.sha512(b"any").digest(), "little") % (2**252 + 27742317777372353535851937790883648493)
    point = crypto_scalarmult_ed25519_base_noclamp(scalar.to_bytes(32, "little"))
    for message in (b"%d" % number for number in range(16)):
        with pytest.raises(InvalidSignature):
            PublicKey(raw).verify(point + scalar.to_bytes(32, "little"), RECORD_DOMAIN, message)


@given(st.binary(max_size=200))
def test_what_another_library_signs_verifies_and_the_other_way_round(message: bytes) -> None:
    other = Ed25519PrivateKey.from_private_bytes(KEY.seed)
    signed = signed_bytes(RECORD_DOMAIN, message)
    KEY.public.verify(other.sign(signed), RECORD_DOMAIN, message)
    other.public_key().verify(KEY.sign(RECORD_DOMAIN, message), signed)


@given(st.binary(max_size=40))
def test_any_bytes_as_a_key(raw: bytes) -> None:
    if len(raw) != 32:
        with pytest.raises(DamagedData):
            PublicKey(raw)
        with pytest.raises(LocalFault):
            SigningKey.from_seed(raw)


def test_the_key_id_is_that_of_the_spec() -> None:
    assert KEY.public.raw.hex() == "03a107bff3ce10be1d70dd18e74bc09967e4d6309ba50d5f1ddc8664125531b8"
    assert KEY.key_id == KEY.public.key_id == key_id_of(KEY.public.raw) == 0x56475AA7
    assert PublicKey(KEY.public.raw) == KEY.public


def test_the_seed_is_not_shown() -> None:
    for text in (repr(KEY), str(KEY), f"{KEY}", repr(KEY.public)):
        assert KEY.seed.hex() not in text
        assert repr(KEY.seed) not in text


def test_key_files(tmp_path: Path) -> None:
    path = tmp_path / "signing.key"
    KEY.to_file(path)
    assert path.stat().st_mode & 0o777 == 0o600
    assert SigningKey.from_file(path).seed == KEY.seed
    with pytest.raises(LocalFault, match="exists already"):
        SigningKey.generate().to_file(path)
    assert SigningKey.from_file(path).seed == KEY.seed


@pytest.mark.parametrize("content", [b"", b"not hexadecimal", b"00" * 31, b"00" * 33, b"\xff\xfe" * 32])
def test_a_key_file_that_holds_no_seed(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "signing.key"
    path.write_bytes(content)
    path.chmod(0o600)
    with pytest.raises(LocalFault, match="holds no signing seed"):
        SigningKey.from_file(path)
