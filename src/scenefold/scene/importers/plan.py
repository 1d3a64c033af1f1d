"""From a source scene to records: in three phases, streamed, the same bytes for the same file.

    1 records   geometry atoms and texture tiles
    2 tables    pages of the group, instance, material, texture, camera and light tables
    3 document  the scene document, which makes the import visible

The tables name the places of the records, and the document those of the tables. Where a place was already
taken in the store, the record moves, and the importer's caller says so with `moved` before it asks for the
next phase. All that can be wrong with a file is found before the first record is handed out.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenefold.base.errors import LocalFault
from scenefold.base.ids import SpaceId
from scenefold.base.limits import LIGHT_TRIANGLES_MAX, TABLE_PAGES_MAX
from scenefold.base.location import FIRST, Location
from scenefold.scene.importers.atoms import CutAtom, cut, group_count
from scenefold.scene.importers.boxes import Box, cube, world_box
from scenefold.scene.importers.emitters import Emitters
from scenefold.scene.importers.framing import default_camera, framing_camera
from scenefold.scene.importers.matrices import move_points
from scenefold.scene.importers.prototypes import decide
from scenefold.scene.importers.runs import Run, make_runs
from scenefold.scene.importers.source import SourceScene
from scenefold.scene.importers.table_pages import table_pages
from scenefold.scene.importers.tiling import tile_count, tiles_of
from scenefold.scene.importers.unshown import unshown
from scenefold.scene.layout import DOCUMENT_LOCATION, GEOMETRY, META, TEXTURES, geometry_lattice, item_location
from scenefold.scene.payloads.document import NOT_CARRIED_MAX, TABLES, SceneDocument, content_hash, encode_document
from scenefold.scene.payloads.environment import TEXELS_OF_A_PAGE
from scenefold.scene.payloads.groups import ATOM_ROW, GROUP_ROW
from scenefold.scene.payloads.light_table import lights_of_a_page
from scenefold.scene.payloads.materials import encode_materials

Progress = Callable[[str, int, int], None]
"""Called with a phase's name ("geometry", "textures", "tables"), and how much of how much is done."""


@dataclass(frozen=True, slots=True)
class ImportItem:
    """A record to put."""

    space: SpaceId
    location: Location
    payload: bytes
    slot: tuple[str, int]
    """Names the item to `ImportPlan.moved`."""
    replaces: bool = False
    """Whether it may replace what lies there: the scene document alone does."""


def _silent(_phase: str, _done: int, _total: int) -> None:
    """Nobody wants to know."""


class ImportPlan:
    """One import. Use: for every phase, put all its items, report those that moved, go on."""

    def __init__(self, source: SourceScene, progress: Progress | None = None) -> None:
        self._source = source
        self._progress = progress or _silent
        self._prototypes = decide(source)
        self._instances = self._prototypes.instance_rows()
        self._runs: list[Run] = []
        self._dropped = self._prototypes.vanished
        for prototype in range(len(self._prototypes.meshes) + 1):
            runs, dropped = make_runs(prototype, self._prototypes.parts(source, prototype))
            self._runs += runs
            self._dropped += dropped
        self._forget_empty_prototypes()
        self.triangles = sum(len(run.triangles) for run in self._runs)
        if self.triangles == 0:
            raise LocalFault(
                "the scene is empty: no triangle has finite corners and an area", where=source.name, remedy="give a file with a mesh in it"
            )
        self._world = world_box(self._instances, self._boxes())
        self._cube = cube(*self._world)
        self._lattice = geometry_lattice(*self._cube)
        self._cameras = source.cameras or [framing_camera(*self._world)]
        self._emitters = Emitters(source.materials)
        self._material_pages = encode_materials(source.materials)
        self._check_table_sizes()
        self._groups: NDArray[np.void] = self._empty_groups()
        self._atoms: list[NDArray[np.void]] = []
        self._places: dict[str, list[Location]] = {"atoms": [], "tiles": [], **{name: [] for name in TABLES}}
        self._taken: set[Location] = set()
        self._next_item: dict[SpaceId, int] = {}
        self._records = hashlib.sha256()
        self._content = b""
        self._counts: dict[str, int] = {}

    @property
    def lattice(self) -> Any:
        """The lattice of the GEOMETRY space, for its creation."""
        return self._lattice

    @property
    def camera_names(self) -> list[str]:
        """The names of the scene's cameras, of which there is always one."""
        return [camera.name for camera in self._cameras]

    def phases(self) -> Iterator[Iterator[ImportItem]]:
        """Three iterators of items. Put all of one, and report what moved, before taking the next."""
        yield self._record_items()
        yield self._table_items()
        yield self._document_items()

    def items(self) -> Iterator[ImportItem]:
        """All items in order, for a store in which nothing moves."""
        for phase in self.phases():
            yield from phase

    def moved(self, item: ImportItem, actual: Location) -> None:
        """Says that an item lies at `actual`, because its own place was taken."""
        name, number = item.slot
        self._places[name][number] = actual

    # --- before the first record

    def _forget_empty_prototypes(self) -> None:
        """Instances of prototypes whose triangles were all without area go; instance 0 always stays."""
        filled = np.unique([run.prototype for run in self._runs])
        keep = np.isin(self._instances["prototype"], filled)
        keep[0] = True
        self._instances = self._instances[keep]

    def _boxes(self) -> dict[int, Box]:
        boxes: dict[int, Box] = {}
        for run in self._runs:
            low, high = (corner.astype(np.float64) for corner in run.box())
            near, far = boxes.get(run.prototype, (low, high))
            boxes[run.prototype] = (np.minimum(near, low), np.maximum(far, high))
        return boxes

    def _check_table_sizes(self) -> None:
        lights = 0
        copies = np.bincount(self._instances["prototype"], minlength=len(self._prototypes.meshes) + 1)
        for run in self._runs:
            lights += int(self._emitters.shines[run.materials].sum()) * int(copies[run.prototype])
        if lights > LIGHT_TRIANGLES_MAX:
            raise LocalFault(
                f"{self._source.name} has {lights} emissive triangles, over {LIGHT_TRIANGLES_MAX}",
                remedy="give light sources simpler meshes",
            )
        # Generous: atoms of 350 triangles, pages half full, long names.
        pages = lights // lights_of_a_page(self._emitters.mapped) + len(self._instances) // 1_000 + self.triangles // 350 // 600
        pages += len(self._runs) // 600 + len(self._material_pages) + self._tiles() // 1_000 + 16
        pages += (len(self._source.textures) + len(self._cameras) + len(self._source.punctual)) // 20
        pages += len(self._source.environment) // TEXELS_OF_A_PAGE + 1
        if pages > TABLE_PAGES_MAX:
            raise LocalFault(f"{self._source.name} is too large for one scene", remedy="split it into several scenes")

    def _tiles(self) -> int:
        return sum(tile_count(texture) for texture in self._source.textures)

    def _empty_groups(self) -> NDArray[np.void]:
        groups = np.zeros(sum(group_count(run) for run in self._runs), GROUP_ROW)
        groups["low"], groups["high"] = np.inf, -np.inf
        return groups

    # --- phase 1

    def _record_items(self) -> Iterator[ImportItem]:
        first_group, done = 0, 0
        for run in self._runs:
            group_starts: dict[int, int] = {}
            matrix = self._a_place_of(run.prototype)
            groups = group_count(run)
            self._groups["prototype"][first_group : first_group + groups] = run.prototype
            self._groups["flags"][first_group : first_group + groups] = run.attributes.flags
            for atom in cut(run, first_group):
                start = atom.start - group_starts.setdefault(atom.group, atom.start)
                self._emitters.add(run.prototype, start, atom)
                self._enter(atom)
                yield self._record(GEOMETRY, self._atom_location(atom, matrix), atom.payload, "atoms")
                done += len(atom.materials)
                self._progress("geometry", done, self.triangles)
            first_group += groups
        self._runs.clear()
        yield from self._tile_items()

    def _a_place_of(self, prototype: int) -> NDArray[np.float64]:
        """Where the first instance of a prototype stands: its atoms lie near what they show there."""
        matrix = np.eye(4)
        matrix[:3] = self._instances["matrix"][np.argmax(self._instances["prototype"] == prototype)]
        return matrix

    def _atom_location(self, atom: CutAtom, matrix: NDArray[np.float64]) -> Location:
        centre = (atom.low.astype(np.float64) + atom.high.astype(np.float64)) / 2
        cells = self._lattice.cells(move_points(matrix, centre[None]))
        location: Location | None = Location.from_padded(bytes(self._lattice.curve.encode(cells)[0]))
        # Equal centres must not overwrite each other: the next free location along the curve.
        while location is None or location in self._taken:
            location = FIRST if location is None else location.next()
        self._taken.add(location)
        return location

    def _enter(self, atom: CutAtom) -> None:
        row = np.zeros(1, ATOM_ROW)
        row["triangles"], row["low"], row["high"] = len(atom.materials), atom.low, atom.high
        self._atoms.append(row)
        group = self._groups[atom.group]
        group["atoms"] += 1
        group["triangles"] += len(atom.materials)
        group["low"] = np.minimum(group["low"], atom.low)
        group["high"] = np.maximum(group["high"], atom.high)

    def _tile_items(self) -> Iterator[ImportItem]:
        done, total = 0, self._tiles()
        for number, texture in enumerate(self._source.textures):
            for payload in tiles_of(number, texture):
                yield self._record(TEXTURES, self._item_place(TEXTURES), payload, "tiles")
                done += 1
                self._progress("textures", done, total)

    def _record(self, space: SpaceId, location: Location, payload: bytes, slot: str) -> ImportItem:
        self._records.update(len(payload).to_bytes(4, "big"))
        self._records.update(payload)
        return self._item(space, location, payload, slot)

    def _item(self, space: SpaceId, location: Location, payload: bytes, slot: str) -> ImportItem:
        places = self._places[slot]
        places.append(location)
        return ImportItem(space, location, payload, (slot, len(places) - 1))

    def _item_place(self, space: SpaceId) -> Location:
        item = self._next_item.get(space, 0)
        self._next_item[space] = item + 1
        return item_location(item)

    # --- phases 2 and 3

    def _table_items(self) -> Iterator[ImportItem]:
        atoms = np.concatenate(self._atoms)
        atoms["location"] = np.array(self._places["atoms"], "V20")
        lights = self._emitters.table(self._instances)
        pages = table_pages(
            self._source, self._cameras, self._groups, atoms, self._instances, lights, self._places["tiles"], self._material_pages
        )
        self._content = content_hash(page for name in TABLES for page in pages[name])
        copies = np.bincount(self._instances["prototype"], minlength=int(self._groups["prototype"].max()) + 1)
        instanced = (self._groups["triangles"].astype(np.int64) * copies[self._groups["prototype"]]).sum()
        self._counts = {
            "groups": len(self._groups), "instances": len(self._instances), "lights": len(lights),
            "materials": len(self._source.materials), "textures": len(self._source.textures),
            "cameras": len(self._cameras), "punctual": len(self._source.punctual), "triangles": self.triangles,
            "instanced_triangles": int(instanced), "atoms": len(atoms), "tiles": len(self._places["tiles"]),
            "environment": len(self._source.environment),
        }  # fmt: skip
        done, total = 0, sum(len(pages[name]) for name in TABLES)
        for name, space in TABLES.items():
            for payload in pages[name]:
                yield self._item(space, self._item_place(space), payload, name)
                done += 1
                self._progress("tables", done, total)

    def _document_items(self) -> Iterator[ImportItem]:
        yield ImportItem(META, DOCUMENT_LOCATION, encode_document(self.document()), ("document", 0), replaces=True)

    def document(self) -> SceneDocument:
        """The scene document; complete once all tables are put."""
        return SceneDocument(
            source=self._source.name,
            world_low=self._world[0],
            world_high=self._world[1],
            lattice_low=self._cube[0],
            lattice_high=self._cube[1],
            counts=self._counts,
            pages={name: tuple(self._places[name]) for name in TABLES},
            default_camera=default_camera(self._cameras),
            content=self._content,
            records=self._records.digest(),
            not_carried=self.not_carried,
        )

    @property
    def not_carried(self) -> tuple[str, ...]:
        """What the import leaves behind, in words."""
        lines = [*self._source.not_carried, *unshown(self._source)]
        if self._dropped:
            lines.append(f"triangles without area ({self._dropped})")
        if len(lines) > NOT_CARRIED_MAX:
            lines = [*lines[: NOT_CARRIED_MAX - 1], f"and {len(lines) - NOT_CARRIED_MAX + 1} more kinds"]
        return tuple(lines)
