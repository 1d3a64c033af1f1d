"""Ways to spoil a packet: by its structure, by its tokens, by its bytes. All draw from the generator that they are given.

A mutation of the tree keeps the bytes well-formed MessagePack in its shortest form, so it reaches the checks behind the
tokens: kinds, bounds, laws. A mutation of bytes reaches the tokens and their lengths.
"""

from __future__ import annotations

import random
from typing import Any

import msgpack

SIZE_MAX = 1 << 16
HEADS = bytes.fromhex("007f808f909fa0bfc0c1c2c3c4c5c6c7cacbcccdcecfd0d3d4d8d9dadbdcdddedfe0ff")
NUMBERS = [edge + by for edge in (0, 32, 128, 256, 4096, 8192, 1 << 16, 1 << 31, 1 << 32, 1 << 53, (1 << 64) - 1) for by in (-1, 0, 1)]
NUMBERS = [number for number in NUMBERS if -(1 << 63) <= number < 1 << 64]
SIZES = [0, 1, 15, 16, 17, 19, 20, 21, 31, 32, 33, 63, 64, 65, 255, 256, 384, 1024, 1025, 61_456, 61_457]
FLOATS = [0.0, -0.0, 1.0, -1.0, 5e-324, 1.8e308, float("inf"), float("-inf"), float("nan")]


def any_value(dice: random.Random) -> Any:
    """A value that some field may dislike."""
    match dice.randrange(8):
        case 0:
            return dice.choice(NUMBERS)
        case 1:
            return dice.randbytes(dice.choice(SIZES))
        case 2:
            return "é" * dice.choice(SIZES[:17])
        case 3:
            return dice.choice(FLOATS)
        case 4:
            return dice.choice([None, True, False])
        case 5:
            return [any_value(dice) for _ in range(dice.randrange(4))]
        case 6:
            return {"key": any_value(dice)}
        case _:
            return [dice.choice(NUMBERS)] * dice.choice([0, 1, 127, 128, 256, 1025, 4097])


def spoil_tree(data: bytes, dice: random.Random) -> bytes:
    """One value somewhere in the packet is changed, moved, doubled or dropped."""
    tree = msgpack.unpackb(data, strict_map_key=False)
    lists = list(_lists_of(tree))
    if not lists:
        return data
    where = dice.choice(lists)
    at = dice.randrange(len(where)) if where else 0
    match dice.randrange(9) if where else 0:
        case 0:
            where.insert(at, any_value(dice))
        case 1:
            where[at] = any_value(dice)
        case 2:
            del where[at]
        case 3:
            where[at:at] = [where[at]] * dice.choice([1, 2, 126, 127, 128, 1024])
        case 4:
            other = dice.choice(lists)
            where[at] = dice.choice(other) if other else None
        case 5:
            where[at] = _nudged(where[at], dice)
        case _:
            where[at] = _alike(where[at], dice)
    return _packed(tree)


def _alike(value: Any, dice: random.Random) -> Any:
    """Another value that the field may well take."""
    if isinstance(value, bool) or value is None:
        return dice.choice([True, False, None])
    if isinstance(value, int):
        return dice.randrange(max(1, 2 * value)) if value >= 0 else value
    if isinstance(value, float):
        return dice.uniform(-1e3, 1e3)
    if isinstance(value, bytes):
        return dice.randbytes(len(value))
    if isinstance(value, str):
        return value[::-1]
    return dice.choice([[], value * 2]) if isinstance(value, list) else value


def _nudged(value: Any, dice: random.Random) -> Any:
    if isinstance(value, bool) or value is None:
        return not value
    if isinstance(value, int):
        return max(-(1 << 63), min((1 << 64) - 1, value + dice.choice([-1, 1, -value, 1 << 16, 1 << 32])))
    if isinstance(value, float):
        return value * dice.choice([-1.0, 0.0, 1e300])
    if isinstance(value, bytes):
        return dice.choice([value[:-1], value + b"\0", b"", value[::-1], value.hex()])
    if isinstance(value, str):
        return dice.choice([value + "\u20ac" * 400, value.encode(), "", value + "\0"])
    return dice.choice([[], [value], value * 2 if isinstance(value, list) else None])


def _lists_of(tree: Any, depth: int = 0) -> Any:
    if isinstance(tree, list):
        yield tree
        if depth < 40:
            for item in tree:
                yield from _lists_of(item, depth + 1)


def _packed(tree: Any) -> bytes:
    try:
        packed: bytes = msgpack.packb(tree)
    except (ValueError, OverflowError, UnicodeEncodeError):
        return b""
    return packed


def spoil_bytes(data: bytes, dice: random.Random) -> bytes:
    """A few bytes are flipped, set, cut, doubled, put in, or the end is cut off."""
    spoilt = bytearray(data)
    for _ in range(dice.choice([1, 1, 1, 2, 3, 8])):
        if not spoilt:
            break
        at = dice.randrange(len(spoilt))
        match dice.randrange(7):
            case 0:
                spoilt[at] ^= 1 << dice.randrange(8)
            case 1:
                spoilt[at] = dice.choice(HEADS)
            case 2:
                del spoilt[at : at + dice.choice([1, 2, 4, 20])]
            case 3:
                spoilt[at:at] = spoilt[at : at + dice.choice([1, 5, 21])] * dice.choice([1, 2, 50])
            case 4:
                spoilt[at:at] = dice.randbytes(dice.choice([1, 3, 9]))
            case 5:
                del spoilt[at:]
            case _:
                # A head that claims more than there is.
                spoilt[at : at + 1] = bytes((dice.choice(b"\xc4\xc5\xc6\xd9\xda\xdb\xdc\xdd\xde\xdf"),)) + dice.choice(
                    [b"\xff", b"\xff\xff", b"\xff\xff\xff\xff", b"\x00\x00\xff\xff", b"\x7f\xff\xff\xff"]
                )
    return bytes(spoilt)


def longer_form(data: bytes, dice: random.Random) -> bytes:
    """A small number or short array somewhere is written longer than it need be."""
    spoilt = bytearray(data)
    at = dice.randrange(len(spoilt)) if spoilt else 0
    if spoilt and spoilt[at] < 0x80:
        width = dice.choice([(0xCC, 1), (0xCD, 2), (0xCE, 4), (0xCF, 8)])
        spoilt[at : at + 1] = bytes((width[0],)) + spoilt[at].to_bytes(width[1], "big")
    elif spoilt and spoilt[at] & 0xF0 == 0x90:
        spoilt[at : at + 1] = b"\xdc\x00" + bytes((spoilt[at] & 0x0F,))
    return bytes(spoilt)


def spliced(first: bytes, second: bytes, dice: random.Random) -> bytes:
    """The beginning of one and the end of another."""
    return first[: dice.randrange(len(first) + 1)] + second[dice.randrange(len(second) + 1) :]


def hostile(head: bytes, dice: random.Random) -> bytes:
    """Behind a good beginning what costs a careless decoder most: nests, claims, endless small things."""
    body = dice.choice([b"\x91", b"\x90", b"\xc0", b"\xdd\xff\xff\xff\xff", b"\xc6\x00\xff\xff\xff", b"\x81\xa0", b"\xa0", b"\x00"])
    head = head[: dice.randrange(len(head) + 1)] + dice.choice([b"", b"\xdd\x00\x00\xff\xff", b"\xdc\xff\xff", b"\xdf\x00\x00\xff\xff"])
    return (head + body * (SIZE_MAX // len(body)))[:SIZE_MAX]
