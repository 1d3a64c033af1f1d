"""What a node has from the cluster's authority: its certificate, and one of them the authority's own key, sealed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


def _nowhere(_certificate: bytes) -> None:
    return


def _nothing() -> None:
    return


@dataclass(frozen=True, slots=True)
class Papers:
    """`certificate`: PEM; empty where nobody looks at certificates. `sealed`: the authority's key as it was sealed to this node when the
    cluster was made; empty of all but one. `keep`: puts a newer certificate in place of this one, on disk; it blocks."""

    certificate: bytes = b""
    sealed: bytes = b""
    keep: Callable[[bytes], None] = _nowhere
    forget_log_key: Callable[[], None] = _nothing
    """Erases the key of the cluster's log, once it counts no more; it blocks."""


NO_PAPERS = Papers()
