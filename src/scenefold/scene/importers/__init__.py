"""Importers: from a scene file to the records of a scene (specs/05-scene-content.md).

    source = read_scene(path)
    plan = plan_import(source)
    for phase in plan.phases(): put all its items, tell `plan.moved(item, actual)` of those that moved

Both steps compute for long and belong in a worker thread. They need no network, and either succeed or raise
one LocalFault before the first record exists.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from scenefold.base.errors import LocalFault
from scenefold.scene.importers.environments import read_environment
from scenefold.scene.importers.faults import bad_file, readable_size
from scenefold.scene.importers.gltf import read_gltf
from scenefold.scene.importers.moments import AT_REST, FPS_USUAL, Moment, moment_of_frame
from scenefold.scene.importers.obj import read_obj
from scenefold.scene.importers.plan import ImportItem, ImportPlan, Progress
from scenefold.scene.importers.source import SourceScene
from scenefold.scene.importers.through_trimesh import read_ply, read_stl

__all__ = [
    "AT_REST",
    "FPS_USUAL",
    "READERS",
    "ImportItem",
    "ImportPlan",
    "Moment",
    "Progress",
    "SourceScene",
    "moment_of_frame",
    "plan_import",
    "read_scene",
]

READERS: dict[str, Callable[[Path], SourceScene]] = {
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": read_stl,
}


def read_scene(path: str | Path, moment: Moment = AT_REST, environment: str | Path | None = None) -> SourceScene:
    """The scene of a file, at a moment of its animations, under the map of another one; LocalFault if it is none, or if anything in it cannot be used."""
    file = Path(path)
    readable_size(file)
    reader = READERS.get(file.suffix.lower())
    if reader is None:
        kinds = ", ".join(READERS)
        what = f"files of kind {file.suffix!r} cannot be imported" if file.suffix else "a file without an ending cannot be imported"
        raise LocalFault(what, where=str(file), remedy=f"give one of {kinds}")
    if moment.time_s is not None and reader is not read_gltf:
        raise bad_file(file, f"files of kind {file.suffix!r} hold no animation", "give neither a time nor a frame")
    try:
        source = reader(file) if moment.time_s is None else read_gltf(file, moment)
        if environment is None:
            return source
        found, left = read_environment(Path(environment))
        return replace(source, environment=found, not_carried=[*source.not_carried, *left])
    except MemoryError as error:
        raise LocalFault("the file is too large for this machine's memory", where=str(file), remedy="split it") from error


def plan_import(source: SourceScene, progress: Progress | None = None) -> ImportPlan:
    """The plan that turns a scene into records; LocalFault for an empty or impossible scene."""
    return ImportPlan(source, progress)
