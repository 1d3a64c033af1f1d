"""The scene document: the one record from which everything else of a scene is found (specs/05-scene-content.md).

It lies at META's first location, is written last, and so makes an import visible at once or not at all.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenefold.base.ids import SpaceId
from scenefold.base.limits import COORDINATE_ABS_MAX, PAYLOAD_BYTES_MAX, TABLE_PAGES_MAX
from scenefold.base.location import LOCATION_BYTES, Location
from scenefold.scene.layout import CAMERAS, GROUPS, INSTANCES, LIGHTS, MATERIALS, TEXTURES
from scenefold.scene.payloads.values import Fields, shorten, unpack_fields
from scenefold.wire import pack_value

KIND, VERSION, ENVIRONMENT_VERSION = "scene", 1, 2
ENVIRONMENT = "environment"
"""The table that only documents of version 2 have."""
DIGEST_BYTES = 32
NOT_CARRIED_MAX = 24
_DIGEST_MARK = b"scenefold/scene content"

TABLES: dict[str, SpaceId] = {
    "groups": GROUPS,
    "instances": INSTANCES,
    "materials": MATERIALS,
    "textures": TEXTURES,
    "cameras": CAMERAS,
    "punctual": LIGHTS,
    "lights": LIGHTS,
    ENVIRONMENT: LIGHTS,
}
"""The tables in the order in which `content` hashes them, and the spaces that hold their pages."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneDocument:
    source: str
    """Name of the file that was imported."""
    world_low: NDArray[np.float64]
    """f64[3]; with `world_high` the box of all instances, slightly enlarged."""
    world_high: NDArray[np.float64]
    lattice_low: NDArray[np.float64]
    """f64[3]; with `lattice_high` the cube that the GEOMETRY space's cells divide."""
    lattice_high: NDArray[np.float64]
    counts: dict[str, int]
    """Entries of each table, by name, and "triangles", "instanced_triangles", "atoms", "tiles"."""
    pages: dict[str, tuple[Location, ...]]
    """Where each table's pages lie, in order, by name."""
    default_camera: str
    content: bytes
    """SHA-256 over the payloads of all pages, tables in the order of TABLES."""
    records: bytes
    """SHA-256 over the payloads of all atoms and tiles in the order of the group and texture tables."""
    not_carried: tuple[str, ...]
    """What the importer could not take over, in words."""

    @property
    def digest(self) -> bytes:
        """Of everything that was imported, tables and records: what a job names, so that all its nodes read one import."""
        return hashlib.sha256(_DIGEST_MARK + self.content + self.records).digest()

    def locations(self) -> list[tuple[SpaceId, Location]]:
        """All table pages in the order of TABLES."""
        return [(TABLES[name], location) for name in TABLES for location in self.pages[name]]


COUNTS = (*TABLES, "triangles", "instanced_triangles", "atoms", "tiles")


def content_hash(pages: Iterable[bytes]) -> bytes:
    """`content` of these pages, all tables in the order of TABLES. Lengths go in, so that no cut is ambiguous."""
    digest = hashlib.sha256()
    for page in pages:
        digest.update(len(page).to_bytes(4, "big"))
        digest.update(page)
    return digest.digest()


def encode_document(document: SceneDocument) -> bytes:
    """The payload; of version 1 if the scene has no environment map, so that older programs read it."""
    version = ENVIRONMENT_VERSION if document.pages[ENVIRONMENT] else VERSION
    payload = pack_value(
        {
            "kind": KIND,
            "version": version,
            "source": shorten(document.source),
            "world": [*document.world_low.tolist(), *document.world_high.tolist()],
            "lattice": [*document.lattice_low.tolist(), *document.lattice_high.tolist()],
            "counts": {name: document.counts[name] for name in _named(COUNTS, version)},
            "pages": {name: b"".join(document.pages[name]) for name in _named(TABLES, version)},
            "default_camera": shorten(document.default_camera),
            "content": document.content,
            "records": document.records,
            "not_carried": [shorten(line) for line in document.not_carried[:NOT_CARRIED_MAX]],
        }
    )
    assert len(payload) <= PAYLOAD_BYTES_MAX
    return payload


def decode_document(payload: bytes) -> SceneDocument:
    """The document; DamagedData if anything is off."""
    fields = unpack_fields(payload, "a scene document")
    fields.require(fields.text("kind") == KIND, "does not begin with its mark")
    version = fields.integer("version", 0, 2**31)
    fields.require(VERSION <= version <= ENVIRONMENT_VERSION, f"has the unknown version {version}")
    world_low, world_high = _box(fields, "world")
    lattice_low, lattice_high = _box(fields, "lattice")
    counts = fields.inner("counts")
    pages = fields.inner("pages")
    document = SceneDocument(
        source=fields.text("source"),
        world_low=world_low,
        world_high=world_high,
        lattice_low=lattice_low,
        lattice_high=lattice_high,
        counts=dict.fromkeys(COUNTS, 0) | {name: counts.integer(name, 0, 2**62) for name in _named(COUNTS, version)},
        pages=dict.fromkeys(TABLES, ()) | {name: _locations(pages, name) for name in _named(TABLES, version)},
        default_camera=fields.text("default_camera"),
        content=_digest(fields, "content"),
        records=_digest(fields, "records"),
        not_carried=tuple(_lines(fields)),
    )
    for part in (counts, pages, fields):
        part.end()
    return document


def _named(names: Iterable[str], version: int) -> list[str]:
    """Those of them that documents of this version have."""
    return [name for name in names if version >= ENVIRONMENT_VERSION or name != ENVIRONMENT]


def _box(fields: Fields, key: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    # The importer enlarges boxes, so they may pass the bound on coordinates a little.
    bound = 4 * COORDINATE_ABS_MAX
    values = np.array(fields.numbers(key, 6, -bound, bound), np.float64)
    values.flags.writeable = False
    fields.require(bool((values[:3] < values[3:]).all()), f"has a box {key!r} that is none")
    return values[:3], values[3:]


def _locations(fields: Fields, key: str) -> tuple[Location, ...]:
    joined = fields.raw(key)
    fields.require(len(joined) % LOCATION_BYTES == 0, f"has a torn location in {key!r}")
    fields.require(len(joined) <= TABLE_PAGES_MAX * LOCATION_BYTES, f"has too many pages in {key!r}")
    return tuple(Location(joined[at : at + LOCATION_BYTES]) for at in range(0, len(joined), LOCATION_BYTES))


def _digest(fields: Fields, key: str) -> bytes:
    value = fields.raw(key)
    fields.require(len(value) == DIGEST_BYTES, f"has an odd {key!r}")
    return value


def _lines(fields: Fields) -> list[str]:
    lines: list[Any] = fields.sequence("not_carried", NOT_CARRIED_MAX)
    fields.require(all(isinstance(line, str) for line in lines), "has an odd 'not_carried'")
    return lines
