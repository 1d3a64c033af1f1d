"""PLY and STL through trimesh's readers, the door to trimesh: what comes out is checked like anything else."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenefold.base.errors import LocalFault
from scenefold.base.limits import COORDINATE_ABS_MAX
from scenefold.scene.importers.faults import bad_file, readable_size
from scenefold.scene.importers.images import linear_of_codes
from scenefold.scene.importers.repair import compact, drop_lost_triangles, mend_normals, mend_uvs
from scenefold.scene.importers.size_checks import check_ply, check_stl
from scenefold.scene.importers.source import MeshPart, NotCarried, SourceScene
from scenefold.scene.payloads.materials import Material

GREY = Material(name="grey", base_color=(0.8, 0.8, 0.8, 1.0), double_sided=True)

PAINTED = Material(name="painted", double_sided=True)
"""For meshes whose vertices have the colour."""


def read_ply(path: Path) -> SourceScene:
    """The mesh of a PLY, in the colours of its vertices, or in grey."""
    check_ply(path, readable_size(path))
    from trimesh.exchange.ply import load_ply

    with path.open("rb") as file:
        loaded = guarded(path, lambda: load_ply(file, skip_materials=True))
    left = NotCarried()
    left.note("face colours", int(loaded.get("face_colors") is not None))
    part = mesh_part(path, loaded, 0, left)
    return single_mesh(path, [part], [GREY if part.colors is None else PAINTED], left)


def read_stl(path: Path) -> SourceScene:
    """The mesh of an STL, in grey."""
    check_stl(path, readable_size(path))
    from trimesh.exchange.stl import load_stl

    with path.open("rb") as file:
        loaded = guarded(path, lambda: load_stl(file))
    # A file of several solids comes as several meshes.
    meshes = list(loaded["geometry"].values()) if "geometry" in loaded else [loaded]
    left = NotCarried()
    return single_mesh(path, [mesh_part(path, mesh, 0, left) for mesh in meshes], [GREY], left)


def load_obj_text(path: Path, text: str, material_names: list[str]) -> dict[str, Any]:
    """What trimesh reads from an OBJ: meshes by name, each with the name of its material."""
    from trimesh.exchange.obj import load_obj

    library = "".join(f"newmtl {name}\n" for name in material_names).encode()
    # trimesh is handed a library of bare names, so that meshes come by material; we read the real one.
    loaded = guarded(path, lambda: load_obj(io.StringIO(f"mtllib names\n{text}"), resolver={"names": library}))
    return dict(loaded)


def guarded(path: Path, load: Callable[[], Any]) -> Mapping[str, Any]:
    """What `load` returns, or one LocalFault: trimesh's readers raise whatever their parsing runs into."""
    try:
        with warnings.catch_warnings():
            # numpy only warns where numbers in a text end early; half a mesh is worse than none.
            warnings.simplefilter("error", DeprecationWarning)
            loaded = load()
    except Exception as error:
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise bad_file(path, f"the file cannot be read as {path.suffix[1:].upper()}, {reason}") from error
    if not isinstance(loaded, Mapping):
        raise bad_file(path, f"the file cannot be read as {path.suffix[1:].upper()}")
    return loaded


def mesh_part(path: Path, loaded: Mapping[str, Any], material: int, left: NotCarried) -> MeshPart:
    """A checked part of trimesh's fields `vertices`, `faces`, `vertex_normals` and a visual's `uv`."""
    positions = _rows(path, loaded.get("vertices"), 3)
    faces = loaded.get("faces")
    triangles = np.empty((0, 3), np.int64) if faces is None else np.asarray(faces)
    if triangles.size == 0:
        return MeshPart(positions[:0], None, None, np.empty((0, 3), np.uint32), material)
    if triangles.ndim != 2 or triangles.shape[1] not in (3, 4) or triangles.dtype.kind not in "iu":
        raise bad_file(path, "its faces are no triangles")
    if triangles.shape[1] == 4:
        triangles = np.concatenate([triangles[:, [0, 1, 2]], triangles[:, [0, 2, 3]]])
    if int(triangles.min()) < 0 or int(triangles.max()) >= len(positions):
        raise bad_file(path, f"a face names vertex {int(triangles.max())}, but there are {len(positions)}")
    normals = _matching(loaded.get("vertex_normals"), len(positions), 3)
    uvs = _matching(getattr(loaded.get("visual"), "uv", None), len(positions), 2)
    colors = _colors(loaded.get("vertex_colors"), len(positions), left)
    whole = MeshPart(positions, normals, uvs, triangles.astype(np.uint32), material, colors=colors)
    part = compact(drop_lost_triangles(whole, left))
    # NaN fails this comparison too.
    if not (np.abs(part.positions) <= COORDINATE_ABS_MAX).all():
        raise bad_file(path, "a vertex has a position that is not finite, or beyond 1e9")
    return mend_uvs(mend_normals(part, left), left)


def _rows(path: Path, values: Any, width: int) -> NDArray[np.float32]:
    rows = np.empty((0, width)) if values is None else np.asarray(values)
    if rows.ndim != 2 or rows.shape[1] != width or rows.dtype.kind not in "fiu":
        raise bad_file(path, "its vertices are no points")
    with np.errstate(over="ignore"):
        return rows.astype(np.float32)


def _matching(values: Any, count: int, width: int) -> NDArray[np.float32] | None:
    """An attribute, if it is one for every vertex."""
    if values is None:
        return None
    rows = np.asarray(values)
    if rows.shape != (count, width) or rows.dtype.kind not in "fiu":
        return None
    with np.errstate(over="ignore"):
        return rows.astype(np.float32)


def _colors(values: Any, count: int, left: NotCarried) -> NDArray[np.float32] | None:
    """float32[count, 4], linear, of bytes with 3 or 4 columns, which programs take for sRGB; alpha is 1 without."""
    if values is None:
        return None
    codes = np.asarray(values)
    if codes.dtype != np.uint8 or codes.ndim != 2 or len(codes) != count or codes.shape[1] not in (3, 4):
        left.note("vertex colours of another kind than bytes")
        return None
    colors = np.ones((count, 4), np.float32)
    colors[:, :3] = linear_of_codes()[codes[:, :3]]
    colors[:, 3:] = codes[:, 3:4] / np.float32(255) if codes.shape[1] > 3 else 1
    return colors


def single_mesh(path: Path, parts: list[MeshPart], materials: list[Material], left: NotCarried) -> SourceScene:
    """The scene of a format that knows no nodes."""
    filled = [part for part in parts if len(part.triangles)]
    if not filled:
        raise LocalFault(
            "the scene is empty: the file has no triangle with finite corners", where=str(path), remedy="give a file with a mesh"
        )
    place = np.eye(4)[None]
    return SourceScene(path.name, [filled], np.zeros(1, np.int64), place, materials, not_carried=left.lines())
