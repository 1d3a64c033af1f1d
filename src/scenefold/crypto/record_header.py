"""The header of a record: clear, signed, 181 bytes, big endian (specs/04-records.md, Record).

      0  version           u8   2             81  session           u64
      1  suite             u8   1, 2          89  expects           32   what it may replace
      2  placement         u8   0 or 1       121  content position  u64
      3  scene             u32               129  key epoch         u32
      7  genesis           32                133  nonce             12
     39  space             u16               145  -- associated data of the cipher ends here --
     41  location          20                145  length            u32  of the ciphertext
     61  epoch             u64               149  digest            32   SHA-256 of the ciphertext
     69  seq               u64               181
     77  writer            u32  key id

Signing the header signs everything: the digest stands for the ciphertext, scene and location for the place. So a
valid record can neither be moved nor put back over a newer one, nor put over what its writer did not expect; the thesis
signs the ciphertext alone, which allows all three.
"""

from __future__ import annotations

import struct
from typing import NamedTuple, Self, TypeAlias

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import SPACE_ID_MAX, KeyId, SceneId, SpaceId
from scenefold.base.limits import CIPHERTEXT_BYTES_MAX
from scenefold.base.location import LOCATION_BYTES, Location
from scenefold.crypto.suites import DEFAULT_SUITE, SUITES

VERSION = 2
PLACED_BY_CLIENT = 0
PLACED_BY_NODE = 1
"""The location field holds 4 zero bytes and a random object id of 16: the node chooses where it lies."""

GENESIS_BYTES = 32
NONCE_BYTES = 12
DIGEST_BYTES = 32
TAG_BYTES = 16

EXPECTS_ANYTHING = bytes(DIGEST_BYTES)
"""As `expects`: whatever is there may be replaced, if the version is higher."""
EXPECTS_NOTHING = b"\xff" * DIGEST_BYTES
"""As `expects`: nothing may be there. Like all zeros no digest that anybody could find a ciphertext for; that of a known word would be one."""

_LAYOUT = struct.Struct(">BBBI32sH20sQQIQ32sQI12sI32s")
HEADER_BYTES = _LAYOUT.size
ASSOCIATED_BYTES = HEADER_BYTES - 4 - DIGEST_BYTES
_PLACEMENT_AT, _EPOCH_AT = 2, 61
_CLOSED = 14
"""Fields of a RecordHeader up to its digest, in the order of the bytes; the three behind come first in the bytes."""
assert (HEADER_BYTES, ASSOCIATED_BYTES) == (181, 145)

_SIZES = (GENESIS_BYTES, LOCATION_BYTES, DIGEST_BYTES, NONCE_BYTES, DIGEST_BYTES)

Version: TypeAlias = tuple[int, int, int, int, bytes]


class IllFormedRecord(DamagedData):
    """The bytes are no record of a version and suite that we know (reject reason 5)."""


class RecordHeader(NamedTuple):
    """What a record says about itself, in the clear. A tuple, since every record that a node sees has one made for it."""

    scene: SceneId
    genesis: bytes
    space: SpaceId
    location: Location
    epoch: int
    """The log position that the author had seen committed."""
    seq: int
    writer: KeyId
    session: int
    expects: bytes
    """EXPECTS_ANYTHING, EXPECTS_NOTHING, or the digest of the record that this one may replace. It counts where a write is judged."""
    content_position: int
    """The log position that the payload's coordinates are of, for fast-forward."""
    key_epoch: int
    nonce: bytes
    length: int
    digest: bytes
    placement: int = PLACED_BY_CLIENT
    suite: int = DEFAULT_SUITE
    """That of the writer's key; it gives the length of the signature."""
    version: int = VERSION

    def encode(self) -> bytes:
        """181 bytes; LocalFault if a field is out of bounds."""
        problem = self._problem()
        if not problem:
            try:
                return _LAYOUT.pack(self.version, self.suite, self.placement, *self[:_CLOSED])
            except struct.error as error:
                problem = str(error)
        raise LocalFault(f"a record header cannot be written: {problem}")

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """The header that `data` is, wholly; IllFormedRecord otherwise."""
        if data and data[0] != VERSION:
            # First, for other versions may have other lengths.
            raise IllFormedRecord(f"a record of version {data[0]}, and this program knows version {VERSION}")
        if len(data) != HEADER_BYTES:
            raise IllFormedRecord(f"a record header has {HEADER_BYTES} bytes, not {len(data)}")
        fields = _LAYOUT.unpack(data)
        header = cls._make((*fields[3:6], Location(fields[6]), *fields[7:], *fields[2::-1]))
        problem = header._problem()
        if problem:
            raise IllFormedRecord(f"ill-formed record header: {problem}")
        return header

    def _problem(self) -> str:
        """What is wrong with the fields, beyond their widths; empty if nothing is."""
        if self.version != VERSION:
            return f"version {self.version}"
        if self.suite not in SUITES:
            return f"suite {self.suite}"
        if self.placement not in (PLACED_BY_CLIENT, PLACED_BY_NODE):
            return f"placement {self.placement}"
        if not self.scene:
            return "scene 0"
        if not 0 < self.space <= SPACE_ID_MAX:
            return f"space {self.space}"
        if not TAG_BYTES <= self.length <= CIPHERTEXT_BYTES_MAX:
            return f"a ciphertext of {self.length} bytes"
        # struct would cut or pad these in silence.
        sizes = len(self.genesis), len(self.location), len(self.expects), len(self.nonce), len(self.digest)
        if sizes != _SIZES:
            return f"genesis, location, expects, nonce and digest of {sizes} bytes, {_SIZES} were expected"
        return ""


def claimed_epoch(header: bytes) -> int:
    """The epoch that the bytes of a header claim, without a look at the rest; 0 if they are none."""
    return int.from_bytes(header[_EPOCH_AT : _EPOCH_AT + 8], "big") if len(header) == HEADER_BYTES else 0


def placement_of(header: bytes) -> int:
    """The placement that the bytes of a header claim, likewise; PLACED_BY_CLIENT if they are none."""
    return header[_PLACEMENT_AT] if len(header) == HEADER_BYTES else PLACED_BY_CLIENT


def version_key(header: RecordHeader) -> Version:
    """Orders the versions of a record: the highest wins, on every copy, whatever the order of arrival."""
    return header.epoch, header.seq, header.writer, header.session, header.digest
