"""Records: what a scene's spaces consist of, encrypted and signed by their writer (specs/04-records.md).

    record  =  header (181 bytes) | signature (as the suite says: 64 or 384 bytes) | ciphertext (as the header says)

AES-192-GCM with the header up to its length and digest as associated data; the writer's signature over the whole header. A node
verifies without the scene's key, before it stores (thesis Algorithm 6); a reader verifies, then opens. All
functions are plain and release the GIL where it is long, so they may run in worker threads.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple, Self

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.limits import PAYLOAD_BYTES_MAX
from scenefold.base.location import Location
from scenefold.crypto.keys import RECORD_DOMAIN, InvalidSignature, PublicKey, SigningKey
from scenefold.crypto.record_header import (
    ASSOCIATED_BYTES,
    DIGEST_BYTES,
    EXPECTS_ANYTHING,
    HEADER_BYTES,
    PLACED_BY_CLIENT,
    TAG_BYTES,
    IllFormedRecord,
    RecordHeader,
)
from scenefold.crypto.suites import SUITES

SYMMETRIC_KEY_BYTES = 24
UNKNOWN_DIGEST = bytes(DIGEST_BYTES)
"""In the header of a record that is yet to be sealed."""


class RecordPlace(NamedTuple):
    """Where a record is claimed to belong."""

    scene: SceneId
    space: SpaceId
    location: Location


@dataclass(frozen=True, slots=True)
class Record:
    """A record as it is stored and sent."""

    header_bytes: bytes
    signature: bytes
    ciphertext: bytes
    _header: RecordHeader | None = field(default=None, init=False, repr=False, compare=False)

    @property
    def header(self) -> RecordHeader:
        """Decoded once, at the first call; IllFormedRecord if it is none."""
        header = self._header
        if header is None:
            header = RecordHeader.decode(self.header_bytes)
            object.__setattr__(self, "_header", header)
        return header

    def encode(self) -> bytes:
        """The record in one piece."""
        return b"".join((self.header_bytes, self.signature, self.ciphertext))

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """The record that `data` is, wholly; IllFormedRecord otherwise. Verifies nothing."""
        data = bytes(data)
        header = RecordHeader.decode(data[:HEADER_BYTES])
        start = HEADER_BYTES + SUITES[header.suite].signature_bytes
        if len(data) != start + header.length:
            raise IllFormedRecord(f"a record of {len(data)} bytes, {start + header.length} were expected")
        return cls(data[:HEADER_BYTES], data[HEADER_BYTES:start], data[start:])


def new_symmetric_key(token: Callable[[int], bytes]) -> bytes:
    """A key for the records of a scene: 24 bytes, AES-192. `token` draws that many random bytes (world.entropy.token)."""
    return token(SYMMETRIC_KEY_BYTES)


@lru_cache(maxsize=8)
def _cipher(symmetric_key: bytes) -> AESGCM:
    """Kept for the few keys that are in use: expanding a key takes as long as sealing a kilobyte."""
    if len(symmetric_key) != SYMMETRIC_KEY_BYTES:
        raise LocalFault(f"a scene's key has {SYMMETRIC_KEY_BYTES} bytes, not {len(symmetric_key)}")
    return AESGCM(symmetric_key)


def seal_record(
    payload: bytes,
    *,
    scene: SceneId,
    genesis: bytes,
    space: SpaceId,
    location: Location,
    epoch: int,
    seq: int,
    session: int,
    nonce: bytes,
    symmetric_key: bytes,
    signing_key: SigningKey,
    expects: bytes = EXPECTS_ANYTHING,
    content_position: int = 0,
    key_epoch: int = 0,
    placement: int = PLACED_BY_CLIENT,
) -> Record:
    """Encrypts and signs a payload of at most 60 KiB; LocalFault if something is out of bounds.

    `nonce`: 12 random bytes, fresh for every record under this key; a retry sends the same record again instead.
    """
    header = RecordHeader(
        scene=scene,
        genesis=genesis,
        space=space,
        location=location,
        epoch=epoch,
        seq=seq,
        writer=signing_key.key_id,
        session=session,
        expects=expects,
        content_position=content_position,
        key_epoch=key_epoch,
        nonce=nonce,
        length=len(payload) + TAG_BYTES,
        digest=UNKNOWN_DIGEST,
        placement=placement,
        suite=signing_key.suite,
    )
    return seal_records([(header, payload)], symmetric_key, signing_key)[0]


def seal_records(drafts: Sequence[tuple[RecordHeader, bytes]], symmetric_key: bytes, signing_key: SigningKey) -> list[Record]:
    """Likewise for many, in order. The headers are whole but for their digest, which may be UNKNOWN_DIGEST."""
    # First all that Python does, then all that the library does: in turns, each drives the other out of the processor's caches.
    heads = [_head(header, payload, signing_key) for header, payload in drafts]
    encrypt = _cipher(symmetric_key).encrypt
    records = []
    for (header, payload), head in zip(drafts, heads, strict=True):
        ciphertext = encrypt(header.nonce, payload, head[:ASSOCIATED_BYTES])
        # The digest closes the header: it is known only now, and the cipher must not depend on it.
        header_bytes = head + hashlib.sha256(ciphertext).digest()
        records.append(Record(header_bytes, signing_key.sign(RECORD_DOMAIN, header_bytes), ciphertext))
    return records


def _head(header: RecordHeader, payload: bytes, signing_key: SigningKey) -> bytes:
    """The header's bytes up to its digest; LocalFault if it does not go with the payload and the key."""
    if len(payload) > PAYLOAD_BYTES_MAX:
        raise LocalFault(
            f"a payload of {len(payload)} bytes, at most {PAYLOAD_BYTES_MAX} are allowed", remedy="split it into several records"
        )
    if (header.length, header.writer, header.suite) != (len(payload) + TAG_BYTES, signing_key.key_id, signing_key.suite):
        raise LocalFault("a record header is not that of its payload and writer")
    return header.encode()[:-DIGEST_BYTES]


def verify_record(record: Record, public_key: PublicKey, place: RecordPlace | None = None) -> RecordHeader:
    """The header, if the writer signed exactly this record for exactly this place.

    IllFormedRecord (reason 5): header, length or place do not fit. InvalidSignature (reason 4): another key,
    or the signature or ciphertext was changed.
    """
    check_claim(record, public_key, place)
    check_signature(record, public_key)
    return record.header


def check_claim(record: Record, public_key: PublicKey, place: RecordPlace | None = None, *, or_husk: bool = False) -> None:
    """The cheap half of `verify_record`: what the record says of itself. `or_husk`: its ciphertext may be missing."""
    header = record.header
    if place is not None and (header.scene, header.space, header.location) != place:
        raise IllFormedRecord("the record belongs elsewhere", where=f"scene {header.scene:08x}, space {header.space}, {header.location!r}")
    if header.length != len(record.ciphertext) and not (or_husk and is_husk(record)):
        raise IllFormedRecord(f"a ciphertext of {len(record.ciphertext)} bytes, {header.length} were announced")
    if header.writer != public_key.key_id:
        raise InvalidSignature(f"the record was written by key {header.writer:08x}, not {public_key.key_id:08x}")
    if header.suite != public_key.suite:
        raise InvalidSignature(f"a record of suite {header.suite} by a key of suite {public_key.suite}")


def is_husk(record: Record) -> bool:
    """Whether it is what is left of a record whose ciphertext is lost: the header and its signature."""
    return not record.ciphertext and record.header.length > 0


def check_header_signature(record: Record, public_key: PublicKey) -> None:
    """That the writer signed this header, whatever became of the ciphertext."""
    public_key.verify(record.signature, RECORD_DOMAIN, record.header_bytes)


def check_signature(record: Record, public_key: PublicKey) -> None:
    """The other half: that the writer said so. Some 100 microseconds, and as long as hashing the ciphertext takes."""
    check_header_signature(record, public_key)
    if hashlib.sha256(record.ciphertext).digest() != record.header.digest:
        raise InvalidSignature("the ciphertext is not the one that was signed")


def verify_records(claims: Iterable[tuple[Record, PublicKey, RecordPlace | None]]) -> list[DamagedData | None]:
    """`verify_record` for many, in order: None where the record is good, else what is wrong with it."""
    return [_complaint(*claim) for claim in claims]


def _complaint(record: Record, public_key: PublicKey, place: RecordPlace | None) -> DamagedData | None:
    try:
        verify_record(record, public_key, place)
    except DamagedData as complaint:
        return complaint
    return None


def open_record(record: Record, symmetric_key: bytes) -> bytes:
    """The payload. DamagedData if this key did not seal this record. Says nothing of the writer: verify first."""
    header = record.header
    try:
        return _cipher(symmetric_key).decrypt(header.nonce, record.ciphertext, record.header_bytes[:ASSOCIATED_BYTES])
    except InvalidTag:
        raise DamagedData(
            "the record cannot be opened with this key",
            where=f"scene {header.scene:08x}, space {header.space}, {header.location!r}",
            remedy="check that the scene's key is the right one",
        ) from None
