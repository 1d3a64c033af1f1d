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
from scenefold.peer.scene_log.scene_judge import SceneJudge
from scenefold.wire import LogValue, SceneBody, SceneLogPublic

REMEMBERED_MAX = 50_000
PACKETS_MAX = 8_192
HEADERS_MAX = 8_192
VALUES_MAX = 1_024

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
        for owner in (RecordHeader, SceneLogPublic, SceneBody):
            stack.enter_context(_decoded_once(owner))
        for owner in (SceneLogPublic, SceneBody):
            stack.enter_context(_encoded_once(owner))
        stack.enter_context(_judged_once())
        yield


@contextmanager
def _decoded_once(owner: Any) -> Iterator[None]:
    before: Any = owner.__dict__["decode"]
    remembering: Any = lru_cache(HEADERS_MAX)(before.__func__)
    owner.decode = classmethod(remembering)
    try:
        yield
    finally:
        owner.decode = before


@contextmanager
def _encoded_once(owner: Any) -> Iterator[None]:
    """By which object it is, first: to look at all that is in it takes a while."""
    encode: Any = owner.encode
    by_value = lru_cache(HEADERS_MAX)(encode)
    remembered: dict[int, tuple[Any, bytes]] = {}

    def quick_encode(self: Any) -> Any:
        known = remembered.get(id(self))
        if known is None:
            if len(remembered) >= HEADERS_MAX:
                remembered.clear()
            # As long as it is remembered nothing else has its number.
            known = remembered[id(self)] = self, by_value(self)
        return known[1]

    owner.encode = quick_encode
    try:
        yield
    finally:
        owner.encode = encode


@contextmanager
def _judged_once() -> Iterator[None]:
    """Each value of a scene's log, behind one header: all who decide on it judge it alike."""
    judge: Any = SceneJudge
    checked = judge._checked
    remembered: dict[tuple[object, ...], tuple[Any, Any]] = {}

    def quick_checked(self: SceneJudge, value: LogValue, *, is_decided: bool) -> Any:
        looked_at = id(self.known.public), self.changes, value.data, value.body, is_decided
        known = remembered.get(looked_at)
        if known is None:
            if len(remembered) >= VALUES_MAX:
                remembered.clear()
            known = remembered[looked_at] = self.known, checked(self, value, is_decided=is_decided)
        return known[1]

    judge._checked = quick_checked
    try:
        yield
    finally:
        judge._checked = checked


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
