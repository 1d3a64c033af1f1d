"""Values of options that speak of members: tokens, names, how long an invitation holds. As in values.py."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Self, TextIO

from scenectl.names import checked_user
from scenectl.values import ONE_WORD, check_address, is_digits
from scenefold.base.errors import UsageFault
from scenefold.base.ids import NodeId, address_of, checked_node_id

ADDRESS_CHARACTERS_MAX = 40
"""What is longer is meant as a token."""
STANDARD_INPUT = "-"
"""In place of a token: other users of a machine see what stands on a command line."""
TOKEN_CHARACTERS_MAX = 1000
DURATION_S_MAX = 30 * 86_400
_UNITS_S = {"d": 86_400, "h": 3_600, "m": 60}


@dataclass(frozen=True)
class TokenOrAddress:
    """What to join by: the address of a node, or the token of an invitation."""

    text: str

    @classmethod
    def parse(cls, text: str) -> Self:
        if len(text) <= ADDRESS_CHARACTERS_MAX and text != STANDARD_INPUT:
            try:
                check_address(text)
            except ValueError:
                # Most who type something short have not copied a token whole.
                hint = "copy the whole word that `scenectl cluster invite` printed, or name a node that runs"
                # A part of a token is a secret, too, and messages are kept in logs.
                shown = repr(text) if text.replace(".", "").isdecimal() else "this"
                raise ValueError(f"{shown} is neither a whole token nor an IPv4 address; {hint}") from None
        return cls(text)

    @property
    def is_address(self) -> bool:
        return len(self.text) <= ADDRESS_CHARACTERS_MAX

    def __str__(self) -> str:
        return self.text


def given_token(asked: TokenOrAddress, given: TextIO | None) -> TokenOrAddress:
    """What was asked for; in place of "-" the first line of standard input."""
    if asked.text != STANDARD_INPUT:
        return asked
    line = "" if given is None else given.readline(TOKEN_CHARACTERS_MAX).strip()
    if len(line) <= ADDRESS_CHARACTERS_MAX:
        raise UsageFault("no token comes on standard input", where="-", remedy="give it as one line")
    return TokenOrAddress(line)


@dataclass(frozen=True)
class Duration:
    """A time span: 30m, 1h, 2d."""

    seconds: int

    @classmethod
    def parse(cls, text: str) -> Self:
        number, unit = text[:-1], _UNITS_S.get(text[-1:])
        if unit is None or not is_digits(number) or not 60 <= int(number) * unit <= DURATION_S_MAX:
            raise ValueError(f"a time span is a number of minutes, hours or days up to 30 days, such as 30m, 1h or 2d, not {text!r}")
        return cls(int(number) * unit)

    def __str__(self) -> str:
        return next(f"{self.seconds // unit}{name}" for name, unit in sorted(_UNITS_S.items()) if self.seconds % unit == 0)


@dataclass(frozen=True)
class MemberName:
    """A member: user:ada, node:192.168.1.12 or node:3232235788."""

    user: str
    node: NodeId | None

    @classmethod
    def parse(cls, text: str) -> Self:
        kind, _, name = text.partition(":")
        if kind == "user":
            return cls(checked_user(name), None)
        if kind != "node":
            raise ValueError(f"a member is user:NAME or node:ADDRESS, not {text!r}")
        if name.isdecimal() and name.isascii() and int(name) < 2**32:
            return cls("", NodeId(int(name)))
        check_address(name)
        return cls("", checked_node_id(name))

    def __str__(self) -> str:
        return f"user:{self.user}" if self.node is None else f"node:{address_of(self.node)}"


@dataclass(frozen=True)
class Grantee:
    """Who is given a scene: a member, of which a node may be named by its address alone."""

    text: str

    @classmethod
    def parse(cls, text: str) -> Self:
        if ":" not in text:
            try:
                check_address(text)
            except ValueError:
                raise ValueError(f"{text[:80]!r} names no member: use user:NAME, node:ID or the address of a node") from None
        else:
            MemberName.parse(text)
        return cls(text)

    def __str__(self) -> str:
        return self.text


def shown_member(name: str) -> str:
    """A member as logs name it, for people: nodes by their address, as they are named to us."""
    from scenefold.crypto import node_named

    node = node_named(name)
    return name if node is None else f"node:{address_of(node)}"


DurationOption = Annotated[Duration, ONE_WORD]
GranteeOption = Annotated[Grantee, ONE_WORD]
MemberOption = Annotated[MemberName, ONE_WORD]
TokenOption = Annotated[TokenOrAddress, ONE_WORD]
