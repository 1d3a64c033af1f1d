"""Wavefront OBJ: geometry through trimesh, indices and materials prepared and checked here."""

from __future__ import annotations

import codecs
import re
from dataclasses import replace
from pathlib import Path

from scenefold.base.errors import LocalFault
from scenefold.base.limits import MATERIALS_MAX
from scenefold.scene.importers.coordinates import CoordinateSet, without_common_transform
from scenefold.scene.importers.faults import bad_file, beside, readable_size
from scenefold.scene.importers.images import TextureList
from scenefold.scene.importers.merging import USE, with_fewer_names
from scenefold.scene.importers.mtl import read_mtl
from scenefold.scene.importers.polygons import FACE_OF_MANY, split_polygons
from scenefold.scene.importers.repair import mend_uvs
from scenefold.scene.importers.source import MeshPart, NotCarried, SourceScene
from scenefold.scene.importers.through_trimesh import GREY, load_obj_text, mesh_part, single_mesh
from scenefold.scene.payloads.materials import Material

_BYTES_MAX = 2 << 30
_MARKS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_FACE_FROM_END = re.compile(r"^[ \t]*f[ \t].*-\d", re.MULTILINE)
_FACE_OF_NOTHING = re.compile(r"^[ \t]*f[ \t](?:.*[ \t])?0+(?:/|\s|$)", re.MULTILINE)
_LIBRARY = re.compile(r"^[ \t]*mtllib[ \t]+(.*)$", re.MULTILINE)
_FACE = re.compile(r"^[ \t]*f[ \t]+(.*)$", re.MULTILINE)
_COUNTED = (("vertex", r"^[ \t]*v[ \t]"), ("texture vertex", r"^[ \t]*vt[ \t]"), ("normal", r"^[ \t]*vn[ \t]"))
_OTHERS = re.compile(r"^[ \t]*(l|p|curv|surf)[ \t]", re.MULTILINE)


def read_obj(path: Path) -> SourceScene:
    """The meshes of an OBJ with the materials of its libraries; grey where there are none."""
    if readable_size(path) > _BYTES_MAX:
        raise bad_file(path, f"the OBJ has more than {_BYTES_MAX} bytes", "convert it to .glb")
    text = _decoded(path.read_bytes())
    left = NotCarried()
    textures = TextureList(left)
    used = _names_used(text)
    known: dict[str, Material] = {}
    for library in dict.fromkeys(name.strip() for name in _LIBRARY.findall(text)):
        known |= _library(path, library, set(used), textures, left)
    text = _LIBRARY.sub("", text)
    left.note("points, lines, curves and surfaces", len(_OTHERS.findall(text)))
    left.note("materials that no library has, grey instead", sum(name not in known for name in used))
    if len(used) >= MATERIALS_MAX:
        text = with_fewer_names(text, known, GREY, left)
        used = _names_used(text)
    if len(used) >= MATERIALS_MAX:
        raise bad_file(path, f"the OBJ uses more than {MATERIALS_MAX - 1} materials that look different")
    if _FACE_OF_NOTHING.search(text):
        raise bad_file(path, "a face names vertex 0: an OBJ counts from 1")
    if _FACE_FROM_END.search(text):
        text = _count_from_start(path, text)
    if FACE_OF_MANY.search(text):
        text = split_polygons(text)
    try:
        loaded = load_obj_text(path, text, used)
    except LocalFault:
        # Looked for only now: most files are good, and this takes as long as reading one.
        _check_indices(path, text)
        raise
    settled = [without_common_transform(material) for material in (GREY, *(known.get(name, GREY) for name in used))]
    number = {name: at for at, name in enumerate(used, start=1)}
    parts: list[MeshPart] = []
    for mesh in loaded.get("geometry", {}).values():
        material = getattr(getattr(mesh.get("visual"), "material", None), "name", None)
        part = mesh_part(path, mesh, number.get(str(material), 0), left)
        parts.append(_with_used_uvs(part, *settled[part.material], left))
    scene = single_mesh(path, parts, [material for material, _ in settled], left)
    scene.textures.extend(textures.textures)
    return scene


def _names_used(text: str) -> list[str]:
    """The materials that an OBJ names, each once, in its order."""
    return list(dict.fromkeys(name.strip() for name in USE.findall(text)))


def _decoded(content: bytes) -> str:
    for mark, encoding in _MARKS.items():
        if content.startswith(mark):
            return content.decode(encoding, "replace").replace("\r", "\n")
    # Two-byte letters without a mark show as zero bytes.
    if content[:2].count(0) == 1:
        return content.decode("utf-16-be" if content[0] == 0 else "utf-16-le", "replace").replace("\r", "\n")
    return content.decode("utf-8", "replace").replace("\r\n", "\n").replace("\r", "\n")


def _library(path: Path, name: str, used: set[str], textures: TextureList, left: NotCarried) -> dict[str, Material]:
    if not (path.parent / name.replace("\\", "/")).is_file():
        # Widely lost on the way; the geometry is still worth having.
        left.note(f"the material library {name!r}, which is missing")
        return {}
    return read_mtl(beside(path, name, "the material library"), textures, left, used)


def _with_used_uvs(part: MeshPart, material: Material, chosen: CoordinateSet, left: NotCarried) -> MeshPart:
    if part.uvs is None or not material.textured:
        left.note("textures on meshes without texture coordinates", int(material.textured))
        return replace(part, uvs=None)
    # An OBJ's v runs upwards, our first row of pixels is the top.
    uvs = part.uvs.copy()
    uvs[:, 1] = 1 - uvs[:, 1]
    return mend_uvs(replace(part, uvs=chosen.apply(uvs)), left)


def _count_from_start(path: Path, text: str) -> str:
    """Faces may count backwards from where they stand; trimesh counts such from the file's end."""
    counts = {"v": 0, "vt": 0, "vn": 0}
    lines = text.replace("\\\n", " ").split("\n")
    for at, line in enumerate(lines):
        words = line.split()
        if not words:
            continue
        if words[0] in counts:
            counts[words[0]] += 1
        elif words[0] == "f" and "-" in line:
            totals = (counts["v"], counts["vt"], counts["vn"])
            lines[at] = "f " + " ".join(_absolute(path, corner, totals) for corner in words[1:])
    return "\n".join(lines)


def _check_indices(path: Path, text: str) -> None:
    """LocalFault if a face names something that the file does not have."""
    text = text.replace("\\\n", " ")
    counts = [len(re.findall(pattern, text, re.MULTILINE)) for _, pattern in _COUNTED]
    for face in _FACE.finditer(text):
        for corner in face[1].split():
            for (what, _), count, field in zip(_COUNTED, counts, corner.split("/"), strict=False):
                # More digits than any count has: no need to make a number of them.
                if field.isascii() and field.isdigit() and (len(field) > 18 or int(field) > count):
                    raise bad_file(path, f"a face names {what} {field[:18]}, but there are {count}")


def _absolute(path: Path, corner: str, totals: tuple[int, int, int]) -> str:
    fields = corner.split("/")
    for at, field in enumerate(fields[:3]):
        if field.startswith("-"):
            if not field[1:].isascii() or not field[1:].isdigit() or not 1 <= int(field[1:10]) <= totals[at]:
                raise bad_file(path, f"a face names {corner!r}, which is not there")
            fields[at] = str(totals[at] + 1 - int(field[1:10]))
    return "/".join(fields)
