"""What strangers and newcomers send: forms, orders, cards, tokens. A value or the refusal of its kind, nothing else."""

from __future__ import annotations

import datetime
import random
import warnings

from fuzz.findings import Finding
from scenefold.base.errors import DamagedData, UsageFault
from scenefold.base.ids import NodeId
from scenefold.crypto import Authority, Card, InvitedKind, MemberSecrets, SealingKey, SigningKey, Token, new_tls_key, tls_key_in
from scenefold.world.discovery import pack_question, read_question

_NOW = datetime.datetime(2026, 3, 1, tzinfo=datetime.UTC)
_SECRETS = MemberSecrets(SigningKey.from_seed(b"s" * 32), SealingKey(b"e" * 32))
_PEM = Authority.create("fuzz", now=_NOW).certify("user:ada", [], tls_key_in(new_tls_key()), keys=_SECRETS.public(), now=_NOW)

CARDS = [Card.read(_PEM).der]
TOKENS = [
    Token(InvitedKind.USER, b"t" * 32, b"m" * 16, 1_800_000_000, 1, 2, tuple(map(NodeId, range(count)))).word().encode()
    for count in range(4)
]
QUESTIONS = [pack_question(SigningKey.from_seed(b"q" * 32), b"n" * 16)]


def card(data: bytes, _dice: random.Random) -> str:
    with warnings.catch_warnings():
        # Serial numbers that no authority gives are read under protest.
        warnings.simplefilter("ignore")
        try:
            found = Card.read(data)
            assert found.tls_key and Card.read(found.der) == found
        except DamagedData as error:
            return f"refused {type(error).__name__} {error.what[:60]}"
    return f"accepted card of a {found.name.partition(':')[0]}"


def token(data: bytes, _dice: random.Random) -> str:
    try:
        found = Token.read(data.decode("utf-8", "replace"))
    except UsageFault as error:
        return f"refused {error.what[:60]}"
    if found.word().replace("-", "") != "".join(data.decode().split()).replace("-", "").lower():
        raise Finding("a token was accepted from a word that is not its own")
    return "accepted token"


def question(data: bytes, _dice: random.Random) -> str:
    found = read_question(data)
    if found is None:
        return "refused question"
    return f"accepted question{', signed' if found.is_signed() else ''}"
