"""Reads single MessagePack tokens at a position, strictly: the shortest form only (specs/03-wire.md, Encoding).

Why not msgpack's own decoder for what strangers send: it builds whatever the bytes ask for before anyone can
object. A frame of 8 MiB full of empty arrays became 600 MB of lists and 2.6 s (measured), and an array header
reserves its whole claimed length. Here the table says what comes next, so nothing else is ever built; a
60 KiB record still decodes in some 10 µs, most of it one copy of its bytes. That copy is wanted: a slice that
is a view would keep an 8 MiB frame alive for one small record.

Only the shortest form is accepted, so that a packet has exactly one encoding and every accepted byte string
re-encodes to itself.

Every function takes the whole buffer and a position, and gives the value and the position behind it. Reading
behind the end raises IndexError or struct.error, which `codec` turns into "truncated".
"""

from __future__ import annotations

import struct

from scenefold.wire.errors import Misfit

NIL = 0xC0
FALSE, TRUE = 0xC2, 0xC3

_u16 = struct.Struct(">H").unpack_from
_u32 = struct.Struct(">I").unpack_from
_u64 = struct.Struct(">Q").unpack_from
_i8 = struct.Struct(">b").unpack_from
_i16 = struct.Struct(">h").unpack_from
_i32 = struct.Struct(">i").unpack_from
_i64 = struct.Struct(">q").unpack_from
_f64 = struct.Struct(">d").unpack_from

TRUNCATED = (IndexError, struct.error)
"""What the functions here raise when the buffer ends too early."""

_NOT_SHORTEST = "not in the shortest form"


def read_uint(data: bytes, at: int) -> tuple[int, int]:
    """An unsigned integer of at most 64 bits."""
    head = data[at]
    if head < 0x80:
        return head, at + 1
    if head == 0xCC:
        value, least, end = data[at + 1], 0x80, at + 2
    elif head == 0xCD:
        value, least, end = _u16(data, at + 1)[0], 1 << 8, at + 3
    elif head == 0xCE:
        value, least, end = _u32(data, at + 1)[0], 1 << 16, at + 5
    elif head == 0xCF:
        value, least, end = _u64(data, at + 1)[0], 1 << 32, at + 9
    else:
        raise Misfit("an unsigned integer was expected")
    if value < least:
        raise Misfit(_NOT_SHORTEST)
    return value, end


def read_negative(data: bytes, at: int) -> tuple[int, int]:
    """A negative integer of at most 64 bits."""
    head = data[at]
    if head >= 0xE0:
        return head - 0x100, at + 1
    if head == 0xD0:
        value, most, end = _i8(data, at + 1)[0], -0x21, at + 2
    elif head == 0xD1:
        value, most, end = _i16(data, at + 1)[0], -0x81, at + 3
    elif head == 0xD2:
        value, most, end = _i32(data, at + 1)[0], -0x8001, at + 5
    elif head == 0xD3:
        value, most, end = _i64(data, at + 1)[0], -0x8000_0001, at + 9
    else:
        raise Misfit("an integer was expected")
    if value > most:
        raise Misfit(_NOT_SHORTEST)
    return value, end


def read_float(data: bytes, at: int) -> tuple[float, int]:
    """A float of 64 bits; never NaN, which has many encodings and equals nothing."""
    if data[at] != 0xCB:
        raise Misfit("a 64-bit float was expected")
    value: float = _f64(data, at + 1)[0]
    if value != value:
        raise Misfit("not a number")
    return value, at + 9


def read_bool(data: bytes, at: int) -> tuple[bool, int]:
    head = data[at]
    if head not in (FALSE, TRUE):
        raise Misfit("true or false was expected")
    return head == TRUE, at + 1


def _take(data: bytes, start: int, size: int, size_max: int) -> tuple[bytes, int]:
    # The limit is judged before the length, so that an absurd claim is named as what it is.
    if size > size_max:
        raise Misfit(f"{size} bytes, at most {size_max} are allowed")
    end = start + size
    if end > len(data):
        raise IndexError
    return data[start:end], end


def read_bin(data: bytes, at: int, size_max: int) -> tuple[bytes, int]:
    """Raw bytes, at most `size_max` of them."""
    head = data[at]
    if head == 0xC4:
        return _take(data, at + 2, data[at + 1], size_max)
    if head == 0xC5:
        size, least, start = _u16(data, at + 1)[0], 1 << 8, at + 3
    elif head == 0xC6:
        size, least, start = _u32(data, at + 1)[0], 1 << 16, at + 5
    else:
        raise Misfit("raw bytes were expected")
    if size < least:
        raise Misfit(_NOT_SHORTEST)
    return _take(data, start, size, size_max)


def read_text(data: bytes, at: int, size_max: int) -> tuple[str, int]:
    """A UTF-8 string of at most `size_max` bytes."""
    head = data[at]
    if 0xA0 <= head <= 0xBF:
        size, least, start = head & 0x1F, 0, at + 1
    elif head == 0xD9:
        size, least, start = data[at + 1], 32, at + 2
    elif head == 0xDA:
        size, least, start = _u16(data, at + 1)[0], 1 << 8, at + 3
    elif head == 0xDB:
        size, least, start = _u32(data, at + 1)[0], 1 << 16, at + 5
    else:
        raise Misfit("a text was expected")
    if size < least:
        raise Misfit(_NOT_SHORTEST)
    raw, end = _take(data, start, size, size_max)
    try:
        return raw.decode(), end
    except UnicodeDecodeError:
        raise Misfit("a text that is not UTF-8") from None


def _read_count(data: bytes, at: int, fixed: int, wide: int) -> tuple[int, int]:
    head = data[at]
    if head & 0xF0 == fixed:
        return head & 0x0F, at + 1
    if head == wide:
        count, least, end = _u16(data, at + 1)[0], 16, at + 3
    elif head == wide + 1:
        count, least, end = _u32(data, at + 1)[0], 1 << 16, at + 5
    else:
        raise Misfit("an array was expected" if fixed == 0x90 else "a map was expected")
    if count < least:
        raise Misfit(_NOT_SHORTEST)
    return count, end


def read_array_head(data: bytes, at: int) -> tuple[int, int]:
    """The number of elements of the array that begins here."""
    return _read_count(data, at, 0x90, 0xDC)


def read_map_head(data: bytes, at: int) -> tuple[int, int]:
    """The number of pairs of the map that begins here."""
    return _read_count(data, at, 0x80, 0xDE)
