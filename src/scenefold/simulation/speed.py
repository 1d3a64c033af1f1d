"""Signatures are made and checked once, and keys agreed on once, in the process of a simulation only.

A simulated cluster signs a status here and verifies it there a hundred times, always the same bytes. Signing and verifying
are pure, so what was signed here is known to be good, and what was judged once is judged alike again; only forgeries and
damaged bytes are ever computed. Five sixths of a run's time would otherwise go there. Two nodes agree on the same secret, and
derive the same key from it, so that is done for both at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import lru_cache
from typing import Any

from scenefold.crypto import PublicKey, RecordHeader, SealingKey, SealingPublicKey, SigningKey, datagrams
from scenefold.peer.membership import hearing
from scenefold.wire import SceneBody, SceneLogPublic

REMEMBERED_MAX = 50_000
PACKETS_MAX = 8_192
HEADERS_MAX = 8_192

_Signed = tuple[bytes, bytes, bytes, bytes]


@contextmanager
def remembered_signatures() -> Iterator[None]:
    """Within this context, in this process."""
    good: dict[_Signed, None] = {}
    verify, sign = PublicKey.verify, SigningKey.sign

    def remember(signed: _Signed) -> None:
        if len(good) >= REMEMBERED_MAX:
            good.clear()
        good[signed] = None

    def quick_verify(self: PublicKey, signature: bytes, domain: bytes, message: bytes) -> None:
        signed = self.raw, bytes(signature), domain, bytes(message)
        if signed not in good:
            verify(self, signature, domain, message)
            remember(signed)

    def remembering_sign(self: SigningKey, domain: bytes, message: bytes) -> bytes:
        signature = sign(self, domain, message)
        remember((self.public.raw, signature, domain, bytes(message)))
        return signature

    PublicKey.verify, SigningKey.sign = quick_verify, remembering_sign  # type: ignore[method-assign]
    try:
        with _remembered_secrets():
            yield
    finally:
        PublicKey.verify, SigningKey.sign = verify, sign  # type: ignore[method-assign]


@contextmanager
def quick_packets() -> Iterator[None]:
    """Each datagram of gossip is decoded, and each status judged, once in this process: pure functions of what all receive alike."""
    module: Any = hearing
    decode, problem_of = module.decode_packet, module.problem_of
    module.decode_packet, module.problem_of = lru_cache(PACKETS_MAX)(decode), lru_cache(PACKETS_MAX)(problem_of)
    try:
        yield
    finally:
        module.decode_packet, module.problem_of = decode, problem_of


@contextmanager
def quick_headers() -> Iterator[None]:
    """Each header of a record or of a scene is packed and read once in this process: nodes, clients and the judge look at the same ones again and again."""
    with ExitStack() as stack:
        for owner, names in _HEADERS.items():
            for name in names:
                stack.enter_context(_remembering(owner, name))
        yield


_HEADERS: dict[type, tuple[str, ...]] = {
    RecordHeader: ("decode",),
    SceneLogPublic: ("decode", "encode", "signable"),
    SceneBody: ("decode", "encode"),
}


@contextmanager
def _remembering(owner: Any, name: str) -> Iterator[None]:
    """A pure method of a class, or a class method of bytes."""
    before: Any = owner.__dict__[name]
    is_of_class = isinstance(before, classmethod)
    remembering: Any = lru_cache(HEADERS_MAX)(before.__func__ if is_of_class else before)
    setattr(owner, name, classmethod(remembering) if is_of_class else _method(remembering))
    try:
        yield
    finally:
        setattr(owner, name, before)


def _method(function: Any) -> Any:
    def method(self: Any) -> Any:
        return function(self)

    return method


@contextmanager
def _remembered_secrets() -> Iterator[None]:
    secrets: dict[tuple[bytes, bytes], bytes] = {}
    module: Any = datagrams
    agree, derived = SealingKey.agree, module.derived

    def quick_agree(self: SealingKey, other: SealingPublicKey) -> bytes:
        one, two = sorted((self.public.raw, other.raw))
        if (one, two) not in secrets:
            if len(secrets) >= REMEMBERED_MAX:
                secrets.clear()
            secrets[one, two] = agree(self, other)
        return secrets[one, two]

    SealingKey.agree = quick_agree  # type: ignore[method-assign]
    module.derived = lru_cache(REMEMBERED_MAX)(derived)
    try:
        yield
    finally:
        SealingKey.agree = agree  # type: ignore[method-assign]
        module.derived = derived
