"""Encodes a scene's tables into pages, once all places of records are known."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from scenefold.base.location import Location
from scenefold.scene.importers.source import SourceScene
from scenefold.scene.importers.tiling import texture_head, tile_count
from scenefold.scene.payloads.cameras import Camera, encode_cameras
from scenefold.scene.payloads.environment import encode_environment
from scenefold.scene.payloads.groups import encode_groups, page_bounds
from scenefold.scene.payloads.instances import INSTANCES_OF_A_PAGE, encode_instances
from scenefold.scene.payloads.light_table import encode_lights
from scenefold.scene.payloads.punctual import encode_punctual
from scenefold.scene.payloads.textures import Texture, encode_textures


def table_pages(
    source: SourceScene,
    cameras: list[Camera],
    groups: NDArray[np.void],
    atoms: NDArray[np.void],
    instances: NDArray[np.void],
    lights: NDArray[np.void],
    tiles: list[Location],
    materials: list[bytes],
) -> dict[str, list[bytes]]:
    """Payloads of all pages by the name of their table. Those of materials are made already."""
    return {
        "groups": _group_pages(groups, atoms),
        "instances": [
            encode_instances(first, instances[first : first + INSTANCES_OF_A_PAGE])
            for first in range(0, len(instances), INSTANCES_OF_A_PAGE)
        ],
        "materials": materials,
        "textures": encode_textures(_heads(source, tiles)),
        "cameras": encode_cameras(cameras),
        "punctual": encode_punctual(source.punctual),
        "environment": encode_environment(source.environment),
        "lights": encode_lights(lights),
    }


def _group_pages(groups: NDArray[np.void], atoms: NDArray[np.void]) -> list[bytes]:
    first_atom = np.concatenate([[0], np.cumsum(groups["atoms"], dtype=np.int64)])
    bounds = page_bounds(groups["atoms"].tolist())
    return [
        encode_groups(start, groups[start:stop], atoms[first_atom[start] : first_atom[stop]]) for start, stop in itertools.pairwise(bounds)
    ]


def _heads(source: SourceScene, tiles: list[Location]) -> list[Texture]:
    heads, at = [], 0
    for number, texture in enumerate(source.textures):
        count = tile_count(texture)
        heads.append(texture_head(number, texture, tuple(tiles[at : at + count])))
        at += count
    return heads
