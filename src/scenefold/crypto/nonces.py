"""A nonce that follows from what is sealed, for what must be sealed to the very same bytes again (specs/16-scene-log.md).

All other nonces are random. A cipher's key serves nothing but its cipher, so what makes the nonce is another key, derived for this purpose.
"""

from __future__ import annotations

from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.hmac import HMAC
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from scenefold.crypto.record_header import NONCE_BYTES

_KEY_BYTES = 32


def nonce_from(symmetric_key: bytes, purpose: bytes, content: bytes) -> bytes:
    """12 bytes that only who has the key can tell: other content has, as far as chance allows, other ones. `purpose`: unlike any other."""
    mac = HMAC(HKDF(hashes.SHA256(), _KEY_BYTES, None, purpose).derive(symmetric_key), hashes.SHA256())
    mac.update(content)
    return mac.finalize()[:NONCE_BYTES]
