"""Which record it is that lies somewhere, in 32 bytes (specs/10-store.md, Digests).

The digest that a header holds is the ciphertext's, and any writer may sign somebody else's ciphertext again. So two versions
can have it in common, and where one must not be taken for another (what is compared, what is owed) the whole header counts: it
says what the record is, where its home is, which version it is and who wrote it.
"""

from __future__ import annotations

import hashlib

VERSION_BYTES = 32
_DOMAIN = b"scenefold/version"


def version_of(header: bytes) -> bytes:
    """Which version a record with this header is."""
    return hashlib.sha256(_DOMAIN + header).digest()
