"""Values of options that are more than a word or a number: sizes, colours, node addresses, places on the line.

`parse` of each raises ValueError with a sentence; cyclopts turns that into wrong usage (exit code 2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol, Self

from cyclopts import Parameter, Token
from cyclopts.validators import Number

from scenectl.names import checked_space
from scenefold.base.ids import SPACE_ID_MAX, checked_node_id
from scenefold.base.image_limits import SIDE_MAX
from scenefold.base.limits import NODES_MAX, POOL_NODES_MAX
from scenefold.base.location import Location
from scenefold.base.prefixes import address_prefix

if TYPE_CHECKING:
    from scenefold.world import Ports

SPACE_NAMES = (
    "meta",
    "geometry",
    "materials",
    "textures",
    "cameras",
    "lights",
    "instances",
    "groups",
    "renders",
    "files",
)
"""Spaces that every scene has, by number from 1 on. Tests hold it equal to scenefold.scene.layout, slow to import."""


class _Value(Protocol):
    @classmethod
    def parse(cls, text: str) -> Self: ...


def _convert(kind: type[_Value], tokens: Sequence[Token]) -> Any:
    return kind.parse(tokens[0].value)


def shown_default(value: object) -> str | None:
    """How help shows a default: not at all, if it is that nothing is given."""
    return None if value is None or value is False else str(value)


ONE_WORD = Parameter(converter=_convert, n_tokens=1, accepts_keys=False, negative="", show_default=shown_default)


@dataclass(frozen=True)
class Size:
    """Width and height of an image in pixels: 640x360."""

    width: int
    height: int

    @classmethod
    def parse(cls, text: str) -> Self:
        width, cross, height = text.lower().partition("x")
        if not (cross and is_digits(width) and is_digits(height)):
            raise ValueError(f"a size is WIDTHxHEIGHT, such as 640x360, not {text!r}")
        if not all(1 <= int(side) <= SIDE_MAX for side in (width, height)):
            raise ValueError(f"a side has 1 to {SIDE_MAX} pixels, not {text!r}")
        return cls(int(width), int(height))

    def __str__(self) -> str:
        return f"{self.width}x{self.height}"


@dataclass(frozen=True)
class Colour:
    """Linear red, green, blue, each finite and from 0 up: 0.8,0.9,1."""

    rgb: tuple[float, float, float]

    @classmethod
    def parse(cls, text: str) -> Self:
        try:
            red, green, blue = (float(part) for part in text.split(","))
        except ValueError:
            raise ValueError(f"a colour is R,G,B, such as 0.8,0.9,1, not {text!r}") from None
        if not all(math.isfinite(part) and part >= 0 for part in (red, green, blue)):
            raise ValueError(f"a colour has three finite numbers from 0 up, not {text!r}")
        return cls((red, green, blue))

    def __str__(self) -> str:
        return ",".join(f"{part:g}" for part in self.rgb)


@dataclass(frozen=True)
class Addresses:
    """Different IPv4 addresses of nodes: 127.0.0.2,127.0.0.3."""

    all: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        addresses = tuple(part.strip() for part in text.split(",") if part.strip())
        for address in addresses:
            check_address(address)
        if not 1 <= len(addresses) <= NODES_MAX:
            raise ValueError(f"a cluster has 1 to {NODES_MAX} nodes, not {len(addresses)}")
        if len(set(addresses)) != len(addresses):
            raise ValueError("an address stands there twice")
        return cls(addresses)

    def __str__(self) -> str:
        return ",".join(self.all)


@dataclass(frozen=True)
class Prefixes:
    """Different addresses, and prefixes of some: 127.0.0.2,10.1.2.0/24."""

    all: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        prefixes = [address_prefix(part.strip()) for part in text.split(",") if part.strip()]
        if not prefixes:
            raise ValueError("at least one address or prefix is needed, such as 10.1.2.0/24")
        if len(set(prefixes)) != len(prefixes):
            raise ValueError("an address or prefix stands there twice")
        return cls(tuple(map(str, prefixes)))

    def __str__(self) -> str:
        return ",".join(self.all)


@dataclass(frozen=True)
class Address:
    """One IPv4 address."""

    text: str

    @classmethod
    def parse(cls, text: str) -> Self:
        check_address(text)
        return cls(text)

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class PortPair:
    """The two port numbers that all nodes of a cluster listen on: 17349,17350."""

    low: int
    high: int

    @classmethod
    def parse(cls, text: str) -> Self:
        low, comma, high = text.partition(",")
        if not (comma and is_digits(low) and is_digits(high)):
            raise ValueError(f"ports are LOW,HIGH, such as 17349,17350, not {text!r}")
        if not (0 < int(low) < 65536 and 0 < int(high) < 65536) or int(low) == int(high):
            raise ValueError(f"ports are two different numbers from 1 to 65535, not {text!r}")
        return cls(int(low), int(high))

    def __str__(self) -> str:
        return f"{self.low},{self.high}"


def cluster_ports(pair: PortPair | None) -> Ports | None:
    """The pair as the rest of the program knows it; None stays the default."""
    from scenefold.world import Ports

    return None if pair is None else Ports(pair.low, pair.high)


@dataclass(frozen=True)
class Place:
    """A location by its leading hexadecimal digits, 1 to 40 of them; what is missing is filled up."""

    digits: str

    @classmethod
    def parse(cls, text: str) -> Self:
        Location.from_digits(text)
        return cls(text.lower().removeprefix("0x"))

    @property
    def first(self) -> Location:
        """The first location that begins with these digits."""
        return Location.from_digits(self.digits)

    @property
    def last(self) -> Location:
        """The last location that begins with these digits."""
        return Location.from_digits(self.digits, filled_with="f")

    def __str__(self) -> str:
        return self.digits


@dataclass(frozen=True)
class NodeCounts:
    """Sizes of clusters: 1,5; or none."""

    all: tuple[int, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        if text.strip().lower() == "none":
            return cls(())
        parts = [part.strip() for part in text.split(",")]
        if not all(is_digits(part) and 1 <= int(part) <= POOL_NODES_MAX for part in parts):
            raise ValueError(f"sizes of clusters are numbers from 1 to {POOL_NODES_MAX}, such as 1,5, or none, not {text!r}")
        return cls(tuple(int(part) for part in parts))

    def __str__(self) -> str:
        return ",".join(str(count) for count in self.all) or "none"


LINE_START = Place("0")
LINE_END = Place("f")


@dataclass(frozen=True)
class Pools:
    """In how many pools nodes render, or auto: in as many as hold the scene; 0 of them."""

    count: int

    @classmethod
    def parse(cls, text: str) -> Self:
        if text == "auto":
            return cls(0)
        if not is_digits(text) or not 1 <= int(text) <= POOL_NODES_MAX:
            raise ValueError(f"pools are auto, or a number from 1 to {POOL_NODES_MAX}, not {text[:80]!r}")
        return cls(int(text))

    def __str__(self) -> str:
        return f"{self.count}" if self.count else "auto"


@dataclass(frozen=True)
class SpaceName:
    """A space by number, 1 to 8191, or by name, such as geometry; whether the scene has it, its log says."""

    text: str

    @classmethod
    def parse(cls, text: str) -> Self:
        if not text:
            raise ValueError(f"a space has a name, such as {SPACE_NAMES[0]}, or a number")
        if text.isascii() and text.isdigit() and not (is_digits(text) and 1 <= int(text) <= SPACE_ID_MAX):
            raise ValueError(f"a space has a number from 1 to {SPACE_ID_MAX}, not {text[:80]}")
        return cls(text if text.isascii() and text.isdigit() else checked_space(text))

    @property
    def number(self) -> int | None:
        """Its number, where that is known without the scene's log: given, or that of a space that every scene has."""
        if self.text in SPACE_NAMES:
            return SPACE_NAMES.index(self.text) + 1
        return int(self.text) if is_digits(self.text) else None

    def __str__(self) -> str:
        return self.text


def name_or_number(text: str) -> str | int:
    """A space as the client takes it."""
    return int(text) if is_digits(text) else text


HD_QUARTER = Size(640, 360)
SMALL_SIZE = Size(64, 48)
ONE_AND_FIVE = NodeCounts((1, 5))
ONE_TWO_FIVE_SIXTEEN = NodeCounts((1, 2, 5, 16))
THREE_FIVE_AND_NINE = NodeCounts((3, 5, 9))
NO_NODES = NodeCounts(())

SizeOption = Annotated[Size, ONE_WORD]
ColourOption = Annotated[Colour, ONE_WORD]
AddressOption = Annotated[Address, ONE_WORD]
AddressesOption = Annotated[Addresses, ONE_WORD]
PrefixesOption = Annotated[Prefixes, ONE_WORD]
PortsOption = Annotated[PortPair, ONE_WORD, Parameter(env_var="SCENEFOLD_PORTS")]
NodeCountsOption = Annotated[NodeCounts, ONE_WORD]
SuiteOption = Literal["ed25519-aes192gcm", "rsa3072-aes192gcm"]
DEFAULT_SUITE: SuiteOption = "ed25519-aes192gcm"
PoolsOption = Annotated[Pools, ONE_WORD]
PlaceOption = Annotated[Place, ONE_WORD]
SpaceOption = Annotated[SpaceName, ONE_WORD]


def whole(least: int, most: int, *, env_var: str | None = None) -> Parameter:
    """An option that is a whole number from `least` to `most`; cyclopts alone would round 1.5."""
    return Parameter(converter=_whole_number, validator=Number(gte=least, lte=most), env_var=env_var)


def _whole_number(_kind: Any, tokens: Sequence[Token]) -> int:
    text = tokens[0].value
    if not text.removeprefix("-").isdecimal() or not text.isascii() or len(text) > 20:
        raise ValueError(f"a whole number is expected, not {text!r}")
    return int(text)


def real(*, gt: float | None = None, gte: float | None = None, lte: float, env_var: str | None = None) -> Parameter:
    """An option that is a number within bounds; cyclopts alone would say of what is none that it is too large."""
    return Parameter(converter=_number, validator=Number(gt=gt, gte=gte, lte=lte), env_var=env_var)


def _number(_kind: Any, tokens: Sequence[Token]) -> float:
    text = tokens[0].value
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise ValueError(f"a number is expected, not {text[:80]!r}")
    return value


def is_digits(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) < 10


def check_address(text: str) -> None:
    try:
        checked_node_id(text)
    except ValueError as problem:
        raise ValueError(f"{problem}, such as 127.0.0.2") from None
