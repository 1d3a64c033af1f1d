"""The container of a glTF: JSON or GLB chunks, buffers and their views.

GLB: "glTF", u32 version, u32 length, then chunks of u32 length, u32 type, data; the first is JSON, the second
may be buffer 0. Nothing is allocated by what a header claims: every claim is first held against the file's
size. Large files are mapped, not read, so that geometry streams from the disk.
"""

from __future__ import annotations

import base64
import binascii
import mmap
import struct
from pathlib import Path
from urllib.parse import unquote

from scenefold.scene.importers.faults import bad_file, beside, identity_of, readable_size
from scenefold.scene.importers.gltf_json import JsonMap, parse_json

_MAGIC, _JSON, _BIN = b"glTF", 0x4E4F534A, 0x004E4942


class GltfFile:
    """The JSON and the bytes of one glTF; buffers are opened when first used."""

    def __init__(self, path: Path) -> None:
        self.path = path
        readable_size(path)
        content = _mapped(path)
        self._bin: memoryview | None = None
        self.json = parse_json(path, self._unwrap(content) if content[:4] == _MAGIC else bytes(content))
        self._buffers = self.json.maps("buffers")
        self._views = self.json.maps("bufferViews")
        self._opened: dict[int, memoryview] = {}
        self._contents: dict[object, bytes] = {}
        self._counted = {identity_of(path)}
        self.bytes_read = len(content)
        """Bytes of all files so far, each once: no honest mesh has more triangles."""

    def _unwrap(self, content: memoryview) -> bytes:
        if len(content) < 20:
            raise bad_file(self.path, "the GLB is cut short within its header")
        version, length = struct.unpack_from("<II", content, 4)
        if version != 2:
            raise bad_file(self.path, f"the GLB has version {version}, not 2")
        if not 20 <= length <= len(content):
            raise bad_file(self.path, f"the GLB says it has {length} bytes, the file has {len(content)}")
        chunks = self._chunks(content[:length])
        if not chunks or chunks[0][0] != _JSON:
            raise bad_file(self.path, "the GLB does not begin with a JSON chunk")
        if len(chunks) > 1 and chunks[1][0] == _BIN:
            self._bin = chunks[1][1]
        return bytes(chunks[0][1])

    def _chunks(self, content: memoryview) -> list[tuple[int, memoryview]]:
        chunks: list[tuple[int, memoryview]] = []
        offset = 12
        # Only the first two matter; others are extensions.
        while offset < len(content) and len(chunks) < 2:
            if offset + 8 > len(content):
                raise bad_file(self.path, "the GLB is cut short within a chunk's header")
            length, kind = struct.unpack_from("<II", content, offset)
            if offset + 8 + length > len(content):
                raise bad_file(self.path, f"a GLB chunk says it has {length} bytes, more than the file holds")
            chunks.append((kind, content[offset + 8 : offset + 8 + length]))
            offset += 8 + length + (-length % 4)
        return chunks

    def buffer(self, number: int) -> memoryview:
        if number not in self._opened:
            self._opened[number] = self._open(number)
        return self._opened[number]

    def _open(self, number: int) -> memoryview:
        entry = self._buffers[number]
        length = entry.integer("byteLength", 1)
        if entry.has("uri"):
            content = self.resource(entry, f"the buffer {number}")
        elif number == 0 and self._bin is not None:
            content = self._bin
        else:
            raise entry.fault("has neither a uri nor a GLB chunk")
        if length > len(content):
            raise entry.fault(f"is {length}, but there are {len(content)} bytes", "byteLength")
        return content[:length]

    def resource(self, entry: JsonMap, what: str) -> memoryview:
        """The bytes behind `entry.uri`: base64 within, or a file beside the glTF."""
        uri = entry.text("uri")
        return memoryview(_decoded(entry, uri)) if _is_data(uri) else _mapped(self._target(uri, what))

    def content(self, entry: JsonMap, what: str) -> bytes:
        """The same, read once and held for all that name it: a file that is mapped stays open, and there may be thousands of images."""
        uri = entry.text("uri")
        target = None if _is_data(uri) else self._target(uri, what)
        key = uri if target is None else identity_of(target)
        if key not in self._contents:
            self._contents[key] = _decoded(entry, uri) if target is None else bytes(_mapped(target))
        return self._contents[key]

    def _target(self, uri: str, what: str) -> Path:
        """The file of a uri, whose bytes count from now on."""
        target = beside(self.path, unquote(uri), what)
        size, identity = readable_size(target), identity_of(target)
        if identity not in self._counted:
            self._counted.add(identity)
            self.bytes_read += size
        return target

    def view(self, number: int) -> tuple[memoryview, int]:
        """A buffer view's bytes, and its stride (0: tightly packed)."""
        entry = self._views[number]
        buffer = entry.index("buffer", len(self._buffers), "buffer")
        if buffer < 0:
            raise entry.fault("is missing", "buffer")
        offset = entry.integer("byteOffset", default=0)
        length = entry.integer("byteLength", 1)
        content = self.buffer(buffer)
        if offset + length > len(content):
            raise entry.fault(f"ends at byte {offset + length} of a buffer of {len(content)} bytes")
        stride = entry.integer("byteStride", 4, 252) if entry.has("byteStride") else 0
        return content[offset : offset + length], stride

    @property
    def views(self) -> int:
        return len(self._views)


def _is_data(uri: str) -> bool:
    return uri.startswith("data:")


def _decoded(entry: JsonMap, uri: str) -> bytes:
    header, comma, data = uri.partition(",")
    if not comma or not header.endswith(";base64"):
        raise entry.fault("is no base64 data", "uri")
    try:
        return base64.b64decode(data, validate=True)
    except (binascii.Error, ValueError) as error:
        raise entry.fault(f"is no base64 data, {error}", "uri") from error


def _mapped(path: Path) -> memoryview:
    with path.open("rb") as file:
        return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
