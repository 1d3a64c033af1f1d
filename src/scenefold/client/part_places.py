"""Where the parts of a split record want to lie (specs/18-data.md, Splitting and merging).

Pieces of an atom want the middle of their box, as an import would put them; bytes are scattered through the space. Both follow from
the record and its version, so that whoever begins anew asks for the same places.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from scenefold.base.location import LOCATION_BYTES, Location
from scenefold.client.access import SceneAccess
from scenefold.client.positions import logged_space
from scenefold.client.wholes import wholes
from scenefold.scene.layout import DOCUMENT_LOCATION, GEOMETRY, INSTANCES, META
from scenefold.scene.log import LoggedSpace
from scenefold.scene.payloads.splits import Cut

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_DOMAIN = b"scenefold/part-place"
_WORLD = 0
"""The prototype that lies in the world as it is."""


class Pieces(NamedTuple):
    """What a record at `entry`, in the version with this digest, is cut into. `position`: the log position that its coordinates belong to."""

    entry: Location
    digest: bytes
    cut: Cut
    contents: Sequence[bytes]
    position: int


async def places_wanted(access: SceneAccess, space: LoggedSpace, pieces: Pieces) -> list[Location]:
    """A place for each piece, in order; two may be equal."""
    if pieces.cut is Cut.TRIANGLES and space.dimensions == 3:
        logged = await logged_space(access, space.id)
        prototypes, middles = await access.in_crypto_lane(_middles, pieces.contents)
        matrix = await _a_place_of(access, prototypes[0]) if space.id == GEOMETRY and prototypes[0] != _WORLD else None
        return await access.in_crypto_lane(_at_middles, logged, middles, matrix, pieces.position)
    about = _DOMAIN + access.identity.genesis + space.id.to_bytes(2, "big") + pieces.entry + pieces.digest
    return [_scattered(about, number) for number in range(len(pieces.contents))]


def _scattered(about: bytes, number: int) -> Location:
    return Location(hashlib.sha256(about + number.to_bytes(2, "big")).digest()[:LOCATION_BYTES])


def _middles(contents: Sequence[bytes]) -> tuple[list[int], NDArray[np.float64]]:
    import numpy as np

    from scenefold.scene.payloads.atom_cuts import middle_of_piece

    found = [middle_of_piece(content) for content in contents]
    return [prototype for prototype, _ in found], np.stack([middle for _, middle in found])


def _at_middles(space: LoggedSpace, middles: NDArray[np.float64], matrix: NDArray[np.float64] | None, written_at: int) -> list[Location]:
    import numpy as np

    if matrix is not None:
        middles = (
            middles[:, 0, None] * matrix[:, 0] + middles[:, 1, None] * matrix[:, 1] + middles[:, 2, None] * matrix[:, 2] + matrix[:, 3]
        )
    # What lies outside of the space goes to its edge, as in a lattice.
    return space.locations_of(np.clip(space.fast_forward(middles, written_at), *space.world_box))


async def _a_place_of(access: SceneAccess, prototype: int) -> NDArray[np.float64] | None:
    """Where the first instance of a prototype stands, float64[3, 4]; None if the scene shows none."""
    from scenefold.scene.payloads.document import decode_document
    from scenefold.scene.payloads.instances import decode_instances, join_instances

    key = META, DOCUMENT_LOCATION
    (found,) = await wholes(await access.get([key]), [key], access.get, access.in_crypto_lane)
    if found is None or found.deleted:
        return None
    pages = [(INSTANCES, place) for place in decode_document(found.payload).pages["instances"]]
    payloads = await wholes(await access.get(pages), pages, access.get, access.in_crypto_lane)
    read = [decode_instances(page.payload) for page in payloads if page is not None and not page.deleted]
    return await access.in_crypto_lane(partial(_first_matrix, prototype), join_instances(read)) if read else None


def _first_matrix(prototype: int, instances: object) -> NDArray[np.float64] | None:
    import numpy as np

    from scenefold.scene.payloads.instances import InstanceTable

    assert isinstance(instances, InstanceTable)
    shown = np.flatnonzero(instances.prototypes == prototype)
    return instances.matrices[shown[0]].astype(np.float64) if len(shown) else None
