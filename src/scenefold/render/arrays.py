"""What kernels are given: the held part of a scene and one job's numbers, as named tuples of arrays.

Named tuples because numba compiles them as they are: a kernel reads `scene.vertices` and Python can build
and inspect the same value. Everything is read-only while a job runs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]
U32 = npt.NDArray[np.uint32]


class MaterialColumn:
    """Columns of `SceneArrays.materials`, float32[materials, WIDTH]."""

    BASE = 0
    """4 columns: linear red, green, blue, alpha."""
    METALLIC = 4
    ROUGHNESS = 5
    EMISSION = 6
    """3 columns: radiance in W / (m2 sr), strength applied."""
    TRANSMISSION = 9
    IOR = 10
    DOUBLE_SIDED = 11
    ALPHA_MODE = 12
    """0 opaque, 1 mask, 2 blend."""
    ALPHA_CUTOFF = 13
    UNLIT = 14
    """1: it shows its base colour, whatever the light."""
    BASE_USE = 15
    """Like the ten that follow it: index into `texture_uses`, or -1. Which channels count is glTF's rule (TEXTURE_SLOTS)."""
    METALLIC_ROUGHNESS_USE = 16
    NORMAL_USE = 17
    OCCLUSION_USE = 18
    EMISSIVE_USE = 19
    TRANSMISSION_USE = 20
    CLEARCOAT_USE = 21
    CLEARCOAT_ROUGHNESS_USE = 22
    CLEARCOAT_NORMAL_USE = 23
    SPECULAR_USE = 24
    SPECULAR_COLOR_USE = 25
    NORMAL_SCALE = 26
    OCCLUSION_STRENGTH = 27
    EMISSIVE = 28
    """3 columns: radiance before the emissive texture, of which EMISSION has the mean in it; rounded to f32."""
    THICKNESS = 31
    """0: a thin wall. Else solid, whatever the number."""
    ATTENUATION_DISTANCE = 32
    """In the world's unit; inf: the inside is clear."""
    ATTENUATION_COLOR = 33
    """3 columns."""
    CLEARCOAT = 36
    CLEARCOAT_ROUGHNESS = 37
    CLEARCOAT_NORMAL_SCALE = 38
    SPECULAR = 39
    SPECULAR_COLOR = 40
    """3 columns; may pass 1."""
    VERTEX_ALPHA = 43
    """1: vertex colours may hide something of it, so it is in no light table unless it is opaque."""
    FEATURES = 44
    """Bits of `Feature`, as a number: what most materials do without, and kernels ask for at once."""
    WIDTH = 45


class Feature:
    """What of a material is not as in most."""

    REFLECTION = 1
    """Its dielectric reflection has a weight or a colour."""
    UNLIT = 2
    NORMAL_MAP = 4
    COAT = 8
    EMISSIVE_MAP = 16
    ROUGH_TRANSMISSION = 32
    """A thin wall that scatters what it lets through; none of it passes in the caster's filter."""
    SOLID = 64
    """The boundary of a body that light enters; nothing of that passes in the caster's filter."""


class TextureUseColumn:
    """Columns of `SceneArrays.texture_uses`, float64[uses, WIDTH]."""

    TEXTURE = 0
    """Index into `textures`."""
    WRAP_S = 1
    """0 repeat, 1 clamp to edge, 2 mirrored repeat."""
    WRAP_T = 2
    NEAREST = 3
    UV_SET = 4
    """0: `uvs`, 1: `uvs2`."""
    M00 = 5
    """u' = M00 u + M01 v + M02, v' = M10 u + M11 v + M12, where u and v are the vertices'."""
    M01 = 6
    M02 = 7
    M10 = 8
    M11 = 9
    M12 = 10
    MINIFY = 11
    """A number of `Minify` (payloads/texture_uses.py)."""
    WIDTH = 12


class TextureColumn:
    """Columns of `SceneArrays.textures`, int64[textures, WIDTH]."""

    OFFSET = 0
    """Of the texture's first byte in `texels`; RGBA8, rows from the top. Its coarser levels follow, each half as wide and high."""
    WIDTH_PX = 1
    HEIGHT_PX = 2
    SRGB = 3
    LEVELS = 4
    """How many there are, the image itself being the first."""
    WIDTH = 5


class LightColumn:
    """Columns of `SceneArrays.punctual_lights`, float64[lights, WIDTH]."""

    KIND = 0
    """0 point, 1 spot, 2 directional."""
    POSITION = 1
    DIRECTION = 4
    """Into which the light shines."""
    COLOR = 7
    """Point and spot: W / sr; directional: W / m2."""
    COS_INNER = 10
    COS_OUTER = 11
    PROBABILITY = 12
    """Of choosing this one among the punctual lights."""
    WIDTH = 13


class SceneArrays(NamedTuple):
    """The part of a scene that a node holds. Triangles of a group are contiguous, in the group's order."""

    vertices: F32
    """[vertices, 3]"""
    normals: F32
    """[vertices, 3]; all zero where the file has none."""
    uvs: F32
    """[vertices, 2]"""
    triangles: U32
    """[triangles, 3], indices into the three above."""
    triangle_material: U16
    """[triangles]"""
    group_first: I64
    """[groups]: a group's first triangle, -1 if it is not held."""
    instance_matrices: F64
    """[instances, 3, 4], prototype to world; instance 0 is the identity."""
    instance_normals: F64
    """[instances, 3, 3]: transposed inverses, for normals."""
    materials: F32
    """[materials, MaterialColumn.WIDTH]"""
    textures: I64
    texels: U8
    linear_of_srgb: F64
    """[256]"""
    emitter_vertices: F32
    """[emitters, 3, 3], world space: all of the scene, on every node."""
    emitter_radiance: F32
    """[emitters, 3]"""
    emitter_two_sided: U8
    emitter_threshold: F32
    """[emitters], alias table."""
    emitter_alias: U32
    punctual_lights: F64
    texture_uses: F64
    """[uses, TextureUseColumn.WIDTH], at least one row."""
    uvs2: F32
    """[vertices, 2], a second set of coordinates; zero where the file has none. [1, 2] unless `has_uvs2`."""
    colors: F32
    """[vertices, 4]: linear, within 0 to 1; one where the file has none. [1, 4] unless `has_colors`."""
    tangents: F32
    """[vertices, 4]: a unit vector of the prototype's space, and +1 or -1: the bitangent is that times normal x tangent, and its
    sign turns under an instance that mirrors. Zero where the file has none: it follows from the texture coordinates then.
    [1, 4] unless `has_tangents`."""
    has_uvs2: bool
    """Whether anything held has them."""
    has_colors: bool
    has_tangents: bool
    environment: F32
    """[h, w, 3]: radiance by direction, row 0 being +Y, and the middle -Z (specs/05-scene-content.md); [1, 1, 3] zeros without a map."""
    environment_rows: F32
    """[h + 1]: cumulative probabilities of rows, from 0 to 1."""
    environment_columns: F32
    """[h, w + 1]: of columns in each row."""
    emitter_uses: F32
    """[emitters]: the emissive texture, an index into `texture_uses`, or -1: `emitter_radiance` is that of every point.
    This and the two that follow are [1] unless `has_emitter_maps`."""
    emitter_emissive: F32
    """[emitters, 3]: radiance before that texture; with its mean it is `emitter_radiance`."""
    emitter_uvs: F32
    """[emitters, 3, 2]: where the corners read it, before the use's transform."""
    has_emitter_maps: bool
    """Whether an emitter of the scene has one: all nodes hold these textures."""
    emitter_reach: F32
    """[emitters]: how far each reaches, in the world, as `surface_kernels.reach_at` has it of a hit: what the end of a shadow ray is held off by."""


class EmptySpace(NamedTuple):
    """Where the job's box is known to be empty (specs/28-rebalancing.md, Empty space)."""

    reach: U8
    """[64, 64, 64]: voxels from each to the next occupied one; [0, 64, 64]: nothing is known."""
    low: F64
    """[3], the corners of all voxels together."""
    high: F64
    per_voxel: F64
    """[3]: voxels a unit."""


NOTHING_KNOWN = EmptySpace(np.zeros((0, 64, 64), np.uint8), np.zeros(3), np.ones(3), np.ones(3))


class JobNumbers(NamedTuple):
    """What is equal for every ray of a job, on every node."""

    box_low: F64
    """[3], the job's box; all geometry lies strictly inside."""
    box_high: F64
    sky: F64
    """[3], radiance of the constant environment."""
    choose_sky: float
    """Probability that next-event estimation asks the sky; the three sum to 1, or are all 0."""
    choose_punctual: float
    choose_emitter: float
    inverse_emitter_power: float
    """1 / sum of luminance x area over all emitters; 0 without any."""
    camera: F64
    """[18]: position 3, right 3, up 3, forward 3 (unit), half width and half height of the image plane at
    distance 1 (perspective) or in world units (orthographic), kind (0, 1), radius of the lens (0: a pinhole), distance of the plane of focus,
    and how far the box is from the camera, or from the plane of an orthographic one (0: it is within)."""
    seed: int
    frame: int
    width: int
    """Of the whole image."""
    height: int
    samples: int
    """Per pixel."""
    depth: int
    """Segments of a path at most, the camera ray being the first; 1..32."""
    stride: int
    """Multiplier of the scattered pixel order; coprime to the pixels of the crop."""
    dice_low: int
    """With `dice_high`, 64 bits of (seed, frame): what all random numbers of the job follow from."""
    dice_high: int
    sampler: int
    """SAMPLER_SOBOL or SAMPLER_INDEPENDENT (dice_kernels.py)."""
    crop_x: int
    """The part of the image that the job makes, in its pixels; all of it: 0, 0, width, height."""
    crop_y: int
    crop_width: int
    crop_height: int
    roulette_from: int
    """Bounce from which on paths may end by chance."""
    clamp_direct: float
    """Most that one contribution of light that was reflected at most once may be, as the mean of its channels; inf: anything."""
    clamp_indirect: float
    """The same of light that was reflected more often."""
    has_environment: bool
    """Whether the scene's map shines; else the constant sky does."""
    environment_cosine: float
    """Of the angle by which the map is turned about +Y, counter-clockwise seen from above."""
    environment_sine: float
    footprint: float = 0.0
    """Squared width of what a path of a pixel stands for: at distance 1 in the middle of the image (perspective), or anywhere in world
    units (orthographic). 0: textures are read at their finest level (footprint_kernels.py)."""
    footprint_cosine: float = 1.0
    """Of the angle between the camera's forward and the corner of its image."""
