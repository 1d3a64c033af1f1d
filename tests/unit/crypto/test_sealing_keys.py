"""What is sealed to a key opens for its holder and purpose alone, and as RFC 9180 says."""

from __future__ import annotations

from pathlib import Path

import pytest
from cryptography.hazmat.primitives import hpke
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.crypto.hpke import OVERHEAD_BYTES, open_base, seal_base
from scenefold.crypto.sealing_keys import AUTHORITY_PURPOSE, LOCKBOX_PURPOSE, SealingKey, SealingPublicKey

_SEEDS = st.binary(min_size=32, max_size=32)
_SUITE = hpke.Suite(hpke.KEM.X25519, hpke.KDF.HKDF_SHA256, hpke.AEAD.AES_256_GCM)


def _token(count: int) -> bytes:
    return bytes(range(7, 7 + count))


@given(_SEEDS, _SEEDS, st.binary(max_size=300), st.binary(max_size=60))
def test_the_library_opens_what_we_seal(recipient: bytes, ephemeral: bytes, plaintext: bytes, info: bytes) -> None:
    key = X25519PrivateKey.from_private_bytes(recipient)
    sealed = seal_base(plaintext, key.public_key(), info, ephemeral)
    assert len(sealed) == len(plaintext) + OVERHEAD_BYTES
    assert _SUITE.decrypt(sealed, key, info) == plaintext


@given(_SEEDS, st.binary(max_size=300), st.binary(max_size=60))
def test_we_open_what_the_library_seals(recipient: bytes, plaintext: bytes, info: bytes) -> None:
    key = X25519PrivateKey.from_private_bytes(recipient)
    assert open_base(_SUITE.encrypt(plaintext, key.public_key(), info), key, info) == plaintext


def test_any_flipped_bit_is_refused() -> None:
    key = SealingKey(bytes(range(32)))
    sealed = key.public.seal(b"twenty-four bytes of key", LOCKBOX_PURPOSE, b"scene", _token)
    for bit in range(8 * len(sealed)):
        # X25519 ignores the highest bit of a public key, but what is derived from its bytes does not.
        flipped = bytearray(sealed)
        flipped[bit // 8] ^= 1 << bit % 8
        with pytest.raises(DamagedData):
            key.open(bytes(flipped), LOCKBOX_PURPOSE, b"scene")


def test_another_key_purpose_or_context_does_not_open_it() -> None:
    key = SealingKey(bytes(range(32)))
    sealed = key.public.seal(b"secret", LOCKBOX_PURPOSE, b"scene", _token)
    assert key.open(sealed, LOCKBOX_PURPOSE, b"scene") == b"secret"
    for opener, purpose, context in (
        (SealingKey(bytes(32)), LOCKBOX_PURPOSE, b"scene"),
        (key, AUTHORITY_PURPOSE, b"scene"),
        (key, LOCKBOX_PURPOSE, b"other"),
    ):
        with pytest.raises(DamagedData, match="not sealed to this key"):
            opener.open(sealed, purpose, context)


@pytest.mark.parametrize("length", [0, 1, 31, 32, 47])
def test_what_is_too_short_is_damaged(length: int) -> None:
    with pytest.raises(DamagedData):
        SealingKey.generate().open(bytes(length), LOCKBOX_PURPOSE, b"")


def test_two_holders_agree_and_a_key_of_low_order_does_not() -> None:
    one, other = SealingKey.generate(), SealingKey.generate()
    assert one.agree(other.public) == other.agree(one.public)
    low = SealingPublicKey(bytes(32))
    with pytest.raises(DamagedData, match="low order"):
        one.agree(low)
    with pytest.raises(DamagedData, match="low order"):
        low.seal(b"secret", LOCKBOX_PURPOSE, b"", _token)


def test_a_key_survives_its_file_and_says_nothing_of_itself(tmp_path: Path) -> None:
    path = tmp_path / "sealing.seed"
    key = SealingKey.generate()
    key.to_file(path)
    assert path.stat().st_mode & 0o777 == 0o600
    assert SealingKey.from_file(path).public == key.public
    assert key.seed.hex() not in repr(key)
    path.write_text("no key\n")
    with pytest.raises(LocalFault, match="no sealing key"):
        SealingKey.from_file(path)
