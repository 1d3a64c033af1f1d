"""If these failed, textures would be read at other places than a file says."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from scenefold.scene.importers.coordinates import CoordinateSet, Reading, settle
from scenefold.scene.payloads.materials import TEXTURE_SLOTS
from scenefold.scene.payloads.texture_uses import IDENTITY, Transform

TURNED: Transform = (0.0, 2.0, 0.5, -1.0, 0.0, 0.25)
DOUBLED: Transform = (2.0, 0.0, 0.0, 0.0, 2.0, 0.0)
readings = st.dictionaries(
    st.sampled_from(TEXTURE_SLOTS),
    st.builds(Reading, st.integers(0, 9), st.integers(0, 3), transform=st.sampled_from([IDENTITY, TURNED, DOUBLED])),
)


def moved(transform: Transform, u: float, v: float) -> tuple[float, float]:
    m00, m01, m02, m10, m11, m12 = transform
    return m00 * u + m01 * v + m02, m10 * u + m11 * v + m12


@given(readings)
def test_each_texture_is_read_where_the_file_says(given_readings: dict[str, Reading]) -> None:
    sets, uses = settle(given_readings)
    assert len(sets) <= 2
    for slot, use in uses.items():
        reading, corner = given_readings[slot], np.array([[0.25, 0.75]], np.float32)
        chosen = sets[use.uv_set]
        u, v = chosen.apply(corner)[0].tolist()
        assert chosen.number == reading.uv_set and use.texture == reading.texture
        assert moved(use.transform, u, v) == moved(reading.transform, 0.25, 0.75)
    lost = {slot: reading for slot, reading in given_readings.items() if slot not in uses}
    assert not {reading.uv_set for reading in lost.values()} & {chosen.number for chosen in sets}
    assert not lost or len(sets) == 2


def test_what_all_agree_on_is_baked() -> None:
    alike = {"base_color": Reading(0, transform=TURNED), "normal": Reading(1, transform=TURNED)}
    sets, uses = settle(alike)
    assert sets == (CoordinateSet(0, TURNED),) and all(use.transform == IDENTITY for use in uses.values())
    sets, uses = settle(alike | {"occlusion": Reading(2)})
    assert sets == (CoordinateSet(0),) and uses["normal"].transform == TURNED and uses["occlusion"].transform == IDENTITY


def test_the_base_colours_set_comes_first() -> None:
    sets, uses = settle({"normal": Reading(1, 0), "base_color": Reading(0, 1), "emissive": Reading(2, 2)})
    assert [chosen.number for chosen in sets] == [1, 0]
    assert (uses["base_color"].uv_set, uses["normal"].uv_set) == (0, 1) and "emissive" not in uses
