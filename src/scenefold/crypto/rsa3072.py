"""RSA with 3,072 bits as suite 2 has it: PSS signatures, OAEP for what is sealed (specs/04-records.md, Suites).

The salts of both are drawn by the library, so what is made here is no function of a simulation's seed; simulated members have
keys of suite 1.
"""

from __future__ import annotations

from typing import Final

from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import padding
from cryptography.hazmat.primitives.asymmetric.rsa import RSAPrivateKey, RSAPublicKey, RSAPublicNumbers, generate_private_key
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, load_pem_private_key

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.crypto.suites import RSA3072, SUITES

MODULUS_BYTES: Final = SUITES[RSA3072].public_key_bytes
EXPONENT: Final = SUITES[RSA3072].exponent
SEALED_BYTES_MAX: Final = MODULUS_BYTES - 2 * 32 - 2
"""Of plaintext: what the two digests of OAEP leave of a block."""
PEM_BEGIN: Final = b"-----BEGIN PRIVATE KEY-----"

_HASH = hashes.SHA256()
_PSS = padding.PSS(padding.MGF1(_HASH), salt_length=32)


def new_key() -> bytes:
    """A new private key, as PEM (PKCS #8). Takes about half a second."""
    return _pem(generate_private_key(EXPONENT, 8 * MODULUS_BYTES))


def private_key(pem: bytes) -> RSAPrivateKey:
    """The key in a PEM; LocalFault if it is none, or of another kind or size."""
    try:
        key = load_pem_private_key(pem, password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm):
        raise LocalFault("these bytes hold no private key in PEM", remedy="restore it from a backup") from None
    if not isinstance(key, RSAPrivateKey) or key.key_size != 8 * MODULUS_BYTES or key.public_key().public_numbers().e != EXPONENT:
        raise LocalFault(f"the private key is not RSA with {8 * MODULUS_BYTES} bits and exponent {EXPONENT}", remedy="make a new one")
    return key


def public_key(modulus: bytes) -> RSAPublicKey:
    """The key with this modulus; DamagedData if no key has it."""
    number = int.from_bytes(modulus, "big")
    if len(modulus) != MODULUS_BYTES or not modulus[0] & 0x80 or not number & 1:
        raise DamagedData(f"these bytes are no RSA modulus of {8 * MODULUS_BYTES} bits")
    return RSAPublicNumbers(EXPONENT, number).public_key()


def modulus_of(key: RSAPrivateKey) -> bytes:
    """What the public key is known by."""
    return key.public_key().public_numbers().n.to_bytes(MODULUS_BYTES, "big")


def sign(key: RSAPrivateKey, message: bytes) -> bytes:
    """A signature of 384 bytes."""
    return key.sign(message, _PSS, _HASH)


def verify(key: RSAPublicKey, signature: bytes, message: bytes) -> None:
    """Returns if the signature is good; the library's InvalidSignature otherwise."""
    key.verify(signature, message, _PSS, _HASH)


def seal(key: RSAPublicKey, plaintext: bytes, label: bytes) -> bytes:
    """384 bytes; LocalFault for more than 318 bytes of plaintext."""
    if len(plaintext) > SEALED_BYTES_MAX:
        raise LocalFault(f"{len(plaintext)} bytes cannot be sealed to an RSA key, at most {SEALED_BYTES_MAX}", remedy="seal a key for them")
    return key.encrypt(plaintext, _oaep(label))


def open_sealed(key: RSAPrivateKey, sealed: bytes, label: bytes) -> bytes:
    """What was sealed to this key under this label; DamagedData for anything else, and no word about why."""
    try:
        return key.decrypt(sealed, _oaep(label))
    except ValueError:
        raise DamagedData("it was not sealed to this key for this purpose, or is damaged") from None


def _oaep(label: bytes) -> padding.OAEP:
    return padding.OAEP(padding.MGF1(_HASH), _HASH, label)


def _pem(key: RSAPrivateKey) -> bytes:
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
