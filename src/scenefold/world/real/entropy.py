"""The system's randomness (port `Entropy`)."""

from __future__ import annotations

import secrets


class RealEntropy:
    """Bytes fit for keys and nonces."""

    def token(self, count: int) -> bytes:
        return secrets.token_bytes(count)

    def uniform(self) -> float:
        return secrets.randbits(53) / (1 << 53)
