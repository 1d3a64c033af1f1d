"""Tokens that invite somebody into a cluster (specs/04-records.md, Invitations).

An invitation is an Ed25519 key pair. The public half goes into the cluster's log, so every node can judge a request that the private
half signed; the private half goes into the token, which one person hands to another. Besides, the token says by what mark to know the
cluster's authority and where to find nodes, so that whoever holds it need not believe anybody on the way.

    version u8 = 1 | kind u8 | seed 32 | mark 16 | expires u32 | low port u16 | high port u16 | count u8 | address u32 ... | check 4

in base32 (RFC 4648, lower case), in groups of eight letters with a hyphen between.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import struct
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Self

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.serialization import Encoding

from scenefold.base.errors import DamagedData, UsageFault
from scenefold.base.ids import NodeId
from scenefold.crypto.key_files import SEED_BYTES
from scenefold.crypto.keys import SigningKey

ENROL_DOMAIN = b"scenefold/enrol"
"""Requests to be enrolled, signed by the key of an invitation."""
ORDER_DOMAIN = b"scenefold/order"
"""Orders of administrators."""
MARK_BYTES = 16
ADDRESSES_MAX = 3
TOKEN_CHARACTERS_MAX = 512
_VERSION = 1
_GROUP = 8
_HEAD = struct.Struct(f">BB{SEED_BYTES}s{MARK_BYTES}sIHHB")
_ADDRESS = struct.Struct(">I")
_CHECK_BYTES = 4


class InvitedKind(IntEnum):
    """What an invitation is for."""

    NODE = 1
    USER = 2


@dataclass(frozen=True, slots=True)
class Token:
    """What an invited person is given. Whoever has it may use it, once."""

    kind: InvitedKind
    seed: bytes = field(repr=False)
    mark: bytes
    """The authority's, by which to know its certificate."""
    expires: int
    """Seconds since 1970. Nodes judge it; here it is for people."""
    low: int
    high: int
    """The cluster's ports."""
    addresses: tuple[NodeId, ...]
    """Nodes to ask; none: look for them on the local network."""

    @property
    def key(self) -> SigningKey:
        """The key of the invitation."""
        return SigningKey.from_seed(self.seed)

    def word(self) -> str:
        """The token as people copy it."""
        assert len(self.addresses) <= ADDRESSES_MAX
        count = len(self.addresses)
        head = _HEAD.pack(_VERSION, self.kind, self.seed, self.mark, self.expires, self.low, self.high, count)
        body = head + b"".join(map(_ADDRESS.pack, self.addresses))
        letters = base64.b32encode(body + _check(body)).decode().rstrip("=").lower()
        return "-".join(letters[at : at + _GROUP] for at in range(0, len(letters), _GROUP))

    @classmethod
    def read(cls, word: str) -> Self:
        """The token in a word; UsageFault if it is none, whatever was written."""
        letters = "".join(word.split()).replace("-", "").upper()
        if len(letters) > TOKEN_CHARACTERS_MAX or not letters.isascii():
            raise _no_token("it is no token")
        try:
            data = base64.b32decode(letters + "=" * (-len(letters) % 8))
        except binascii.Error:
            raise _no_token("it is no token") from None
        body, check = data[:-_CHECK_BYTES], data[-_CHECK_BYTES:]
        if not body or _check(body) != check:
            raise _no_token("the token was not copied whole, or has a mistake in it")
        if body[0] != _VERSION:
            raise UsageFault(f"the token has version {body[0]}, this program knows {_VERSION}", where="token", remedy="update this program")
        try:
            _, kind, seed, mark, expires, low, high, count = _HEAD.unpack_from(body)
            addresses = tuple(NodeId(address) for (address,) in _ADDRESS.iter_unpack(body[_HEAD.size :]))
            known = cls(InvitedKind(kind), seed, mark, expires, low, high, addresses)
        except (struct.error, ValueError):
            raise _no_token("the token says nothing that this program understands") from None
        # The last letter has spare bits, and letters may be missing that were none: one token, one word.
        if count != len(addresses) or count > ADDRESSES_MAX or known.word().replace("-", "").upper() != letters:
            raise _no_token("the token was not copied whole, or has a mistake in it")
        return known


def mark_of(authority_certificate: bytes) -> bytes:
    """By what to know a cluster's authority: the beginning of the SHA-256 of its certificate (PEM or DER). DamagedData if it is none."""
    return hashlib.sha256(authority_der(authority_certificate)).digest()[:MARK_BYTES]


def authority_der(certificate: bytes) -> bytes:
    """A certificate (PEM or DER) as DER; DamagedData if it is none."""
    try:
        is_pem = certificate.lstrip().startswith(b"-----")
        parsed = x509.load_pem_x509_certificate(certificate) if is_pem else x509.load_der_x509_certificate(certificate)
        return parsed.public_bytes(Encoding.DER)
    except (ValueError, x509.InvalidVersion, UnsupportedAlgorithm):
        raise DamagedData("the authority's certificate is none") from None


def authority_pem(certificate: bytes) -> bytes:
    """Likewise as PEM, which is what TLS takes."""
    return pem_of(certificate)


def pem_of(certificate: bytes) -> bytes:
    """Any certificate as PEM."""
    return x509.load_der_x509_certificate(authority_der(certificate)).public_bytes(Encoding.PEM)


def _check(body: bytes) -> bytes:
    return hashlib.sha256(b"scenefold/token" + body).digest()[:_CHECK_BYTES]


def _no_token(what: str) -> UsageFault:
    return UsageFault(what, where="token", remedy="copy the whole word that `scenectl cluster invite` printed")
