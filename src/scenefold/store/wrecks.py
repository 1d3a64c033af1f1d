"""What may be put over a record whose stored header has rotted (specs/10-store.md, Damage). Pure, inside the write transaction.

The version that was acknowledged there is not known any more. To take it for none would let a compare-and-set replace it in silence, and
would let anybody put an older signed version back. To refuse everything would shut the place for ever, since there is one copy. So what is
left of the record judges: its ciphertext, if whole, says which record it was; a header that has changed still says which version it was, to
the bits that turned over.
"""

from __future__ import annotations

import hashlib

from scenefold.base.errors import DamagedData
from scenefold.crypto import EXPECTS_ANYTHING, HEADER_BYTES, SUITES, Record, RecordHeader, version_key
from scenefold.store.judging import Outcome, PutResult
from scenefold.store.layout import HEADER_AT, STORED_BYTES_MAX


def judge_over_wreck(new: Record, wreck: memoryview) -> PutResult:
    """STORED if a client's record may be put over this value, DAMAGED if nobody can tell."""
    header = new.header
    left = _digests_left(wreck)
    is_same = header.digest in left or _header_left(wreck) == new.header_bytes
    if is_same or header.expects in left or (header.expects == EXPECTS_ANYTHING and not _may_be_newer(wreck, header)):
        return PutResult(Outcome.STORED, header.digest)
    return PutResult(Outcome.DAMAGED)


def judge_copy_over_wreck(new: Record, _wreck: memoryview) -> PutResult:
    """A sound copy heals: whoever hands it over answers for its version, and here is none to hold against it."""
    return PutResult(Outcome.STORED, new.header.digest)


def _header_left(wreck: memoryview) -> bytes:
    return bytes(wreck[HEADER_AT : HEADER_AT + HEADER_BYTES])


def _digests_left(wreck: memoryview) -> set[bytes]:
    """The digest of the ciphertext, and of what else it might be: its beginning follows from sizes that may have rotted, too."""
    if len(wreck) > STORED_BYTES_MAX:
        return set()
    begins = [HEADER_AT + HEADER_BYTES + suite.signature_bytes for suite in SUITES.values()]
    return {hashlib.sha256(wreck[begin:]).digest() for begin in begins if begin < len(wreck)}


def _may_be_newer(wreck: memoryview, new: RecordHeader) -> bool:
    """Whether the header that lies there says that it is as new. One that is no header any more says nothing."""
    try:
        return version_key(RecordHeader.decode(_header_left(wreck))) >= version_key(new)
    except DamagedData:
        return False
