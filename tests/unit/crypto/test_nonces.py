"""If this failed, a nonce would be made with the cipher's own key, or one nonce would serve two purposes."""

from __future__ import annotations

import hmac

from hypothesis import given
from hypothesis import strategies as st

from scenefold.crypto import NONCE_BYTES, nonce_from

KEY = bytes(range(24))


def _hmac(key: bytes, message: bytes) -> bytes:
    return hmac.digest(key, message, "sha256")


@given(st.binary(min_size=24, max_size=24), st.binary(min_size=1, max_size=40), st.binary(max_size=300))
def test_a_nonce_is_a_mac_under_a_key_derived_for_its_purpose(key: bytes, purpose: bytes, content: bytes) -> None:
    derived = _hmac(_hmac(bytes(32), key), purpose + b"\1")
    assert nonce_from(key, purpose, content) == _hmac(derived, content)[:NONCE_BYTES]


def test_it_follows_from_key_purpose_and_content() -> None:
    found = {nonce_from(key, what, of) for key in (KEY, bytes(24)) for what in (b"one", b"other") for of in (b"", b"this", b"that")}
    assert len(found) == 12


def test_purpose_and_content_do_not_run_into_each_other() -> None:
    assert nonce_from(KEY, b"on", b"ething") != nonce_from(KEY, b"one", b"thing")
