"""Holds what a PLY or STL header claims against the file's size, before a reader allocates by it."""

from __future__ import annotations

import struct
from pathlib import Path

from scenefold.scene.importers.faults import bad_file

_HEADER_LINES_MAX = 1_000
_LINE_BYTES_MAX = 4_096
_SIZES = {
    "char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2, "uint16": 2,
    "int": 4, "uint": 4, "int32": 4, "uint32": 4, "float": 4, "float32": 4, "double": 8, "float64": 8,
}  # fmt: skip


def check_ply(path: Path, size: int) -> None:
    """LocalFault if the header is none, or claims more elements than the file has room for."""
    with path.open("rb") as file:
        if file.readline(_LINE_BYTES_MAX).strip() != b"ply":
            raise bad_file(path, "the file is no PLY: it does not begin with 'ply'")
        text, elements = False, []
        for _ in range(_HEADER_LINES_MAX):
            words = file.readline(_LINE_BYTES_MAX).decode("latin-1").split()
            if words[:1] == ["end_header"]:
                break
            if words[:1] == ["format"]:
                text = words[1:2] == ["ascii"]
            elif words[:1] == ["element"]:
                if len(words) != 3 or not words[2].isascii() or not words[2].isdigit() or len(words[2]) > 15:
                    raise bad_file(path, f"the PLY header has an odd line, {' '.join(words)[:40]!r}")
                elements.append([int(words[2]), 0])
            elif words[:1] == ["property"]:
                if not elements or len(words) < 3 or words[1] not in {*_SIZES, "list"}:
                    raise bad_file(path, f"the PLY header has an odd line, {' '.join(words)[:40]!r}")
                # A list has at least its length.
                elements[-1][1] += _SIZES[words[1]] if words[1] != "list" else _SIZES.get(words[2], 1)
        else:
            raise bad_file(path, "the PLY header has no end")
        left = size - file.tell()
    # In text, every number has at least one letter, and one between it and the next.
    needed = sum(count * (1 if text else max(row, 1)) for count, row in elements)
    if needed > left:
        raise bad_file(path, f"the PLY header claims elements of {needed} bytes, there are {left}")


def check_stl(path: Path, size: int) -> None:
    """LocalFault if the file is neither a whole binary STL nor text."""
    with path.open("rb") as file:
        start = file.read(84)
    if size >= 84 and size == 84 + 50 * int(struct.unpack_from("<I", start, 80)[0]):
        return
    if not start.lstrip().lower().startswith(b"solid"):
        raise bad_file(path, "the STL is neither text nor as long as its header says")
