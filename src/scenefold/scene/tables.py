"""A scene's tables, read from its records: what every node holds before it renders (specs/05-scene-content.md).

Reading takes two rounds and knows no network:

    document = decode_document(payload of META at DOCUMENT_LOCATION)
    tables = SceneTables.from_payloads(document, payloads of document.locations(), in that order)

after which geometry is fetched group by group: `tables.groups.locations(g)` in GEOMETRY, and textures tile by
tile: `tables.textures[t].tiles` in TEXTURES. All that one table says about another is checked here, so that
what indexes into these arrays later need not check again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from scenefold.base.errors import DamagedData
from scenefold.scene.payloads.cameras import Camera, decode_cameras
from scenefold.scene.payloads.document import TABLES, SceneDocument, content_hash
from scenefold.scene.payloads.environment import Environment, join_environment
from scenefold.scene.payloads.geometry import GeometryAtom, decode_atom
from scenefold.scene.payloads.groups import GroupTable, decode_groups, join_groups
from scenefold.scene.payloads.instances import InstanceTable, decode_instances, join_instances
from scenefold.scene.payloads.light_table import NO_MATERIAL, LightTable, decode_lights, join_lights
from scenefold.scene.payloads.materials import Material, decode_materials
from scenefold.scene.payloads.punctual import PunctualLight, decode_punctual
from scenefold.scene.payloads.textures import Texture, join_textures

Entry = TypeVar("Entry")
Page = TypeVar("Page", GroupTable, InstanceTable, LightTable)


@dataclass(frozen=True, slots=True, eq=False)
class SceneTables:
    document: SceneDocument
    groups: GroupTable
    instances: InstanceTable
    materials: list[Material]
    textures: list[Texture]
    cameras: list[Camera]
    punctual: list[PunctualLight]
    lights: LightTable
    environment: Environment

    @classmethod
    def from_payloads(cls, document: SceneDocument, payloads: Sequence[bytes | None]) -> SceneTables:
        """The tables whose pages lie at `document.locations()`; DamagedData if any is missing or off."""
        pages = _pages_by_table(document, payloads)
        tables = cls(
            document,
            join_groups(_arrays(pages["groups"], decode_groups)),
            join_instances(_arrays(pages["instances"], decode_instances)),
            _entries(pages["materials"], decode_materials),
            join_textures(pages["textures"]),
            _entries(pages["cameras"], decode_cameras),
            _entries(pages["punctual"], decode_punctual),
            join_lights(_arrays(pages["lights"], decode_lights)),
            join_environment(pages["environment"]),
        )
        _check(tables)
        return tables

    def camera(self, name: str | None = None) -> Camera | None:
        """The camera of this name, or the default one; None if there is none of that name."""
        wanted = self.document.default_camera if name is None else name
        return next((camera for camera in self.cameras if camera.name == wanted), None)

    def group_atoms(self, group: int, payloads: Sequence[bytes | None]) -> list[GeometryAtom]:
        """A group's atoms, from the payloads at `groups.locations(group)`; DamagedData if one is not its own."""
        first = int(self.groups.first_atom[group])
        atoms = []
        for number, payload in enumerate(payloads, start=first):
            if payload is None:
                raise DamagedData(f"an atom of group {group} is missing")
            atom = decode_atom(payload)
            self._check_atom(atom, group, number)
            atoms.append(atom)
        return atoms

    def _check_atom(self, atom: GeometryAtom, group: int, number: int) -> None:
        belongs = atom.group == group and atom.prototype == self.groups.prototypes[group]
        fits = len(atom.triangles) == self.groups.atoms["triangles"][number] and atom.flags == self.groups.flags[group]
        known = int(atom.materials.max()) < len(self.materials)
        if not (belongs and fits and known):
            raise DamagedData(f"an atom of group {group} is not the one that the group table speaks of")


def instance_groups(groups: GroupTable, instances: InstanceTable) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """All (instance, group) pairs: two arrays, ordered by instance, then group."""
    order = np.argsort(groups.prototypes, kind="stable")
    ranked = groups.prototypes[order]
    starts = np.searchsorted(ranked, instances.prototypes, side="left")
    counts = np.searchsorted(ranked, instances.prototypes, side="right") - starts
    pair_instances = np.repeat(np.arange(len(instances), dtype=np.int64), counts)
    before = np.repeat(np.cumsum(counts) - counts, counts)
    within = np.arange(len(pair_instances), dtype=np.int64) - before
    return pair_instances, order[np.repeat(starts, counts) + within].astype(np.int64)


def _pages_by_table(document: SceneDocument, payloads: Sequence[bytes | None]) -> dict[str, list[bytes]]:
    whole = [payload for payload in payloads if payload is not None]
    if len(whole) != len(document.locations()) or len(whole) != len(payloads):
        raise DamagedData("a page of the scene's tables is missing")
    if content_hash(whole) != document.content:
        raise DamagedData("the scene's tables are not those that its document names")
    if not (document.pages["groups"] and document.pages["instances"]):
        raise DamagedData("the scene document names no geometry")
    pages, at = {}, 0
    for name in TABLES:
        count = len(document.pages[name])
        pages[name] = whole[at : at + count]
        at += count
    return pages


def _arrays(payloads: Sequence[bytes], decode: Callable[[bytes], Page]) -> list[Page]:
    pages, expected = [], 0
    for payload in payloads:
        page = decode(payload)
        if page.first != expected:
            raise DamagedData("the pages of a table are out of order")
        expected += len(page)
        pages.append(page)
    return pages


def _entries(payloads: Sequence[bytes], decode: Callable[[bytes], tuple[int, list[Entry]]]) -> list[Entry]:
    entries: list[Entry] = []
    for payload in payloads:
        first, page = decode(payload)
        if first != len(entries):
            raise DamagedData("the pages of a table are out of order")
        entries += page
    return entries


def _check(tables: SceneTables) -> None:
    for name in TABLES:
        if len(getattr(tables, name)) != tables.document.counts[name]:
            raise DamagedData(f"the scene document counts {name} wrong")
    for material in tables.materials:
        if any(use.texture >= len(tables.textures) for _, use in material.uses()):
            raise DamagedData(f"the material {material.name!r} names a texture that is not there")
    # Prototype 0, the world itself, is empty where everything is instanced.
    wanted = tables.instances.prototypes
    if not ((wanted == 0) | np.isin(wanted, tables.groups.prototypes)).all():
        raise DamagedData("an instance names a prototype that is not there")
    _check_lights(tables)


def _check_lights(tables: SceneTables) -> None:
    lights, groups = tables.lights, tables.groups
    if len(lights) == 0:
        return
    known = (lights.instances < len(tables.instances)) & (lights.groups < len(groups)) & (lights.alias < len(lights))
    if not known.all():
        raise DamagedData("the light table names what is not there")
    owners = tables.instances.prototypes[lights.instances] == groups.prototypes[lights.groups]
    if not (owners & (lights.triangles < groups.triangles[lights.groups])).all():
        raise DamagedData("the light table names a triangle that is not there")
    mapped = [number for number, material in enumerate(tables.materials) if material.emissive_texture is not None]
    if not np.isin(lights.materials[lights.materials != NO_MATERIAL], mapped).all():
        raise DamagedData("the light table names a material that has no emissive texture")
