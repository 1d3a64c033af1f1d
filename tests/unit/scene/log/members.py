"""Members of a scene, made from numbers."""

from __future__ import annotations

from scenefold.crypto import MemberSecrets, SealingKey, SigningKey
from scenefold.wire import Grant, KeyEntry, Role


def secrets_of(number: int) -> MemberSecrets:
    """The keys of member `number`."""
    return MemberSecrets(SigningKey(bytes(31) + bytes([number])), SealingKey(bytes(30) + bytes([1, number])))


def grant(number: int, role: Role = Role.READER, **changes: object) -> Grant:
    """The entry that lets that member use the scene."""
    secrets = secrets_of(number)
    signing, sealing = secrets.signing.public, secrets.sealing.public
    fields = {"name": f"user:m{number}", "role": role, "signing": KeyEntry(1, signing.raw), "sealing": KeyEntry(1, sealing.raw)}
    return Grant(**{**fields, **changes})  # type: ignore[arg-type]


MAKER = grant(200, Role.OWNER)
