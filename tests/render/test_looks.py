"""If this fails, textures are read at other places than a material says, or vertex colours do not count.

A square seen straight from the front, whose texels end where pixels do: what a pixel shows is one texel, wherever its rays fall.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from render.rig import Rendered, Rig
from render.shapes import grid, looking, scene
from scenefold.render.contract import load_renderer
from scenefold.render.kit.rig import Rig as KitRig
from scenefold.render.renderers.mitsuba import library
from scenefold.scene.importers.source import MeshPart, SourceTexture
from scenefold.scene.payloads.cameras import Camera
from scenefold.scene.payloads.materials import AlphaMode, Material
from scenefold.scene.payloads.punctual import PunctualLight
from scenefold.scene.payloads.texture_uses import TextureUse, Wrap

SIDE = 8
EYE = looking((0, 0, 5), (0, 0, 0), kind="orthographic", ymag=1.0)
TEXELS = np.random.default_rng(8).integers(0, 256, (4, 4, 4), np.uint8)
Floats = npt.NDArray[np.float64]


def image_of(texels: npt.NDArray[np.uint8]) -> SourceTexture:
    return SourceTexture("texels", texels.shape[1], texels.shape[0], False, True, lambda: texels)


def square() -> MeshPart:
    """Its first coordinates run from 0 to 1, its second ones twice as far, from -1 on."""
    whole = grid((-1, -1, 0), (2, 0, 0), (0, 2, 0), 2, 0, textured=True)
    assert whole.uvs is not None
    return replace(whole, uvs2=whole.uvs * np.float32(2.0) - np.float32(1.0))


def shown(material: Material, mesh: MeshPart, nodes: int = 2, samples: int = 2, **options: object) -> Rendered:
    rig = Rig(scene([[mesh]], [material], [EYE], textures=[image_of(TEXELS)]), 4)
    return rig.render("voronoi", nodes, width=SIDE, height=SIDE, samples=samples, **options)  # type: ignore[arg-type]


def expected(use: TextureUse) -> Floats:
    """[SIDE, SIDE, 4]: the texel in the middle of each pixel."""
    middles = (np.arange(SIDE) + 0.5) / SIDE
    u, v = np.meshgrid(middles, middles)
    if use.uv_set:
        u, v = 2 * u - 1, 2 * v - 1
    m00, m01, m02, m10, m11, m12 = use.transform
    places = []
    for place, wrap in ((m00 * u + m01 * v + m02, use.wrap_s), (m10 * u + m11 * v + m12, use.wrap_t)):
        index = np.floor(place * 4).astype(int)
        mirrored = np.minimum(index % 8, 7 - index % 8)
        places.append({Wrap.REPEAT: index % 4, Wrap.CLAMP: np.clip(index, 0, 3), Wrap.MIRROR: mirrored}[wrap])
    found: Floats = TEXELS[places[1], places[0]] / 255
    return found


TURNED = (0.0, 1.0, 0.5, -1.0, 0.0, 0.25)
USES = [
    TextureUse(0, nearest=True),
    TextureUse(0, 1, Wrap.MIRROR, Wrap.CLAMP, True),
    TextureUse(0, 0, Wrap.CLAMP, Wrap.MIRROR, True, (2.0, 0.0, -0.5, 0.0, 2.0, 1.0)),
    TextureUse(0, 1, Wrap.REPEAT, Wrap.MIRROR, True, TURNED),
]


@pytest.mark.parametrize("use", USES)
def test_a_texture_is_read_as_its_use_says(use: TextureUse) -> None:
    # A second texture with another use: each is read by its own.
    other = TextureUse(0, nearest=False, transform=(3.0, 0.0, 0.0, 0.0, 3.0, 0.0))
    material = Material(base_color=(0.5, 1.0, 0.25, 1.0), base_color_texture=use, metallic_roughness_texture=other)
    albedo = shown(material, square()).layers["albedo"]
    assert np.abs(albedo - expected(use)[..., :3] * (0.5, 1.0, 0.25)).max() < 1e-6


@pytest.mark.parametrize("use", USES)
def test_alpha_cuts_where_the_use_says(use: TextureUse) -> None:
    material = Material(base_color_texture=use, alpha_mode=AlphaMode.MASK, alpha_cutoff=0.5)
    image = shown(material, square(), sky=(7.0, 7.0, 7.0), depth=1)
    assert np.array_equal(image.beauty[..., 0] > 3.5, expected(use)[..., 3] < 0.5)


def test_vertex_colours_multiply_the_base_colour_and_its_alpha() -> None:
    mesh = square()
    mesh = replace(mesh, colors=np.tile(np.array([0.5, 0.25, 1.0, 0.75], np.float32), (len(mesh.positions), 1)))
    use = TextureUse(0, nearest=True)
    albedo = shown(Material(base_color_texture=use), mesh).layers["albedo"]
    assert np.abs(albedo - expected(use)[..., :3] * (0.5, 0.25, 1.0)).max() < 1e-4
    blended = Material(base_color=(0.0, 0.0, 0.0, 0.8), alpha_mode=AlphaMode.BLEND, vertex_alpha=True)
    image = shown(blended, mesh, samples=256, sky=(1.0, 1.0, 1.0), depth=1)
    assert abs(image.beauty.mean() - (1 - 0.8 * 0.75)) < 0.01


def test_what_is_unlit_shows_its_base_colour_and_has_no_other_light() -> None:
    use = TextureUse(0, nearest=True)
    bare = Material(base_color=(0.5, 1.0, 0.25, 1.0), base_color_texture=use, emissive=(9.0, 9.0, 9.0), transmission=0.5, unlit=True)
    image = shown(bare, square(), sky=(3.0, 2.0, 1.0))
    assert np.abs(image.beauty - expected(use)[..., :3] * (0.5, 1.0, 0.25)).max() < 1e-3


def test_weights_of_one_and_white_tints_change_nothing() -> None:
    """A texture of ones makes kernels take the other way."""
    ones = SourceTexture("ones", 2, 2, False, True, lambda: np.full((2, 2, 4), 255, np.uint8))
    images = []
    for use in (None, TextureUse(0)):
        glossy = Material(
            base_color=(0.7, 0.3, 0.2, 1.0), roughness=0.4, specular_texture=use, specular_color_texture=use,
            transmission=0.4, transmission_texture=use,
        )  # fmt: skip
        rig = Rig(scene([[square()]], [glossy], [EYE], textures=[ones]), 4)
        images.append(rig.render("voronoi", 1, width=SIDE, height=SIDE, samples=8, sky=(1.0, 1.0, 1.0)))
    assert np.array_equal(images[0].radiance, images[1].radiance)


def test_transmission_is_what_factor_and_texture_say() -> None:
    """Of a black body nothing but the reflection and what passes is left; a second one says how much is reflected."""
    use = TextureUse(0, nearest=True)
    clear = Material(base_color=(1.0, 1.0, 1.0, 1.0), transmission=0.8, transmission_texture=use, ior=1.0, roughness=0.1)
    image = shown(clear, square(), samples=512, depth=1, sky=(1.0, 1.0, 1.0))
    assert np.abs(image.beauty[..., 0] - 0.8 * expected(use)[..., 0]).max() < 0.1
    assert abs((image.beauty[..., 0] - 0.8 * expected(use)[..., 0]).mean()) < 0.01


NORMALS = np.zeros((4, 4, 4), np.uint8)
"""Tilted by 0.6 along u and 0.3 against v, each to either side; the third row stands upright."""
NORMALS[..., 0], NORMALS[..., 1], NORMALS[..., 2], NORMALS[..., 3] = 204, 166, 230, 255
NORMALS[:, 1, 0], NORMALS[1, :, 1], NORMALS[2] = 51, 89, (128, 128, 255, 255)


def normals_of(mesh: MeshPart, use: TextureUse, eye: Camera = EYE, placed: npt.NDArray[np.float64] | None = None) -> Floats:
    """[SIDE, SIDE, 3]: what the shader takes for the normal."""
    where = np.eye(4) if placed is None else placed
    material = Material(normal_texture=use, normal_scale=0.5)
    parts, extra = ([[mesh]], [(0, np.eye(4))]) if placed is None else ([[square()], [mesh]], [(0, FAR), (1, where)])
    whole = scene(parts, [material], [eye], placed=extra, textures=[image_of(NORMALS)])
    found: Floats = Rig(whole, 4).render("voronoi", 2, width=SIDE, height=SIDE, samples=2).layers["normal"].astype(np.float64)
    return found


FAR = np.eye(4)
FAR[:3, 3] = 50.0


def texel_normals(use: TextureUse) -> tuple[Floats, Floats, Floats]:
    """What each pixel's texel says along the tangent, the bitangent and the normal, of length 1."""
    middles = (np.arange(SIDE) + 0.5) / SIDE
    u, v = np.meshgrid(middles, middles)
    m00, m01, m02, m10, m11, m12 = use.transform
    texel = NORMALS[np.floor((m10 * u + m11 * v + m12) * 4).astype(int) % 4, np.floor((m00 * u + m01 * v + m02) * 4).astype(int) % 4] / 255
    x, y, z = (2 * texel[..., 0] - 1) * 0.5, (2 * texel[..., 1] - 1) * 0.5, 2 * texel[..., 2] - 1
    length = np.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


def test_normal_maps_tilt_along_the_coordinates() -> None:
    use = TextureUse(0, nearest=True)
    x, y, z = texel_normals(use)
    assert np.abs(normals_of(square(), use) - np.stack([x, y, z], -1)).max() < 1e-3
    # The picture turned by a quarter: its u runs down the square, its v to the left.
    turned_use = TextureUse(0, nearest=True, transform=TURNED)
    x, y, z = texel_normals(turned_use)
    assert np.abs(normals_of(square(), turned_use) - np.stack([y, -x, z], -1)).max() < 1e-3


def test_given_tangents_count_and_mirrors_turn_the_bitangent() -> None:
    use = TextureUse(0, nearest=True)
    x, y, z = texel_normals(use)
    mesh = square()
    given = np.tile(np.array([0.0, 1.0, 0.0, -1.0], np.float32), (len(mesh.positions), 1))
    found = normals_of(replace(mesh, tangents=given), use)
    # The tangent is y; the bitangent is -(z x y) = x.
    assert np.abs(found - np.stack([y, x, z], -1)).max() < 1e-3
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    found = normals_of(mesh, use, placed=mirror)[:, ::-1]
    assert np.abs(found - np.stack([-x, y, z], -1)).max() < 1e-3


def test_from_behind_a_normal_map_is_turned_around() -> None:
    use = TextureUse(0, nearest=True)
    x, y, z = texel_normals(use)
    behind = looking((0, 0, -5), (0, 0, 0), kind="orthographic", ymag=1.0)
    found = normals_of(square(), use, behind)[:, ::-1]
    assert np.abs(found + np.stack([x, y, z], -1)).max() < 1e-3


@pytest.mark.parametrize("cosine", [1.0, 0.5])
@pytest.mark.parametrize("mapped", [False, True])
def test_a_clear_coat_mirrors_its_share_and_dims_what_it_covers_by_that(cosine: float, mapped: bool) -> None:
    """Under an even white sky. A coat as smooth as this loses nothing, and Lambert's body gives back all it gets."""
    eye = looking((5 * np.sqrt(1 - cosine**2), 0, 5 * cosine), (0, 0, 0), kind="orthographic", ymag=0.2)
    map_of_coat = TextureUse(0) if mapped else None
    for base, share in ((1.0, 1.0), (0.0, 0.8 * (0.04 + 0.96 * (1 - cosine) ** 5))):
        material = Material(
            base_color=(base, base, base, 1.0), specular=0.0, clearcoat=0.8, clearcoat_roughness=0.1,
            clearcoat_normal_texture=map_of_coat, clearcoat_normal_scale=0.2,
        )  # fmt: skip
        rig = Rig(scene([[square()]], [material], [eye], textures=[image_of(NORMALS)]), 4)
        image = rig.render("voronoi", 2, width=SIDE, height=SIDE, samples=400, depth=2, sky=(1.0, 1.0, 1.0))
        error = 4 * float(np.sqrt(image.variance[..., 0].mean())) / SIDE
        mean = float(image.beauty[..., 0].mean())
        if mapped:
            assert mean < share + 0.03 + error, "no more than comes in"
            continue
        assert abs(mean - share) < 0.005 * share + error


def test_an_emissive_texture_is_seen_texel_by_texel() -> None:
    use = TextureUse(0, 1, nearest=True)
    image = shown(Material(emissive=(3.0, 2.0, 1.0), emissive_texture=use, emissive_mean=(0.5, 0.5, 0.5)), square(), depth=1)
    assert np.abs(image.beauty - expected(use)[..., :3] * (3.0, 2.0, 1.0)).max() < 1e-3


@pytest.mark.skipif(not library.is_installed() or not library.llvm_library(), reason="mitsuba is an optional extra, and needs LLVM")
@pytest.mark.parametrize("use", [USES[1], USES[2]])
def test_mitsuba_shows_the_same(use: TextureUse) -> None:
    """Of a pixel both show the same texel under the same vertex colour; Mitsuba wraps both ways as the first one."""
    use = replace(use, wrap_t=use.wrap_s)
    mesh = square()
    mesh = replace(mesh, colors=np.tile(np.array([0.5, 0.25, 1.0, 0.75], np.float32), (len(mesh.positions), 1)))
    whole = scene([[mesh]], [Material(base_color_texture=use)], [EYE], textures=[image_of(TEXELS)])
    image = KitRig(whole, load_renderer("mitsuba"), 4).render("voronoi", 1, width=SIDE, height=SIDE, samples=2)
    assert np.abs(image.layers["albedo"] - expected(use)[..., :3] * (0.5, 0.25, 1.0)).max() < 1e-4


TINTED = Material(
    base_color=(0.6, 0.3, 0.2, 1.0), roughness=0.6, specular=0.8, specular_color=(9.0, 2.0, 0.0),
    specular_texture=TextureUse(0), specular_color_texture=TextureUse(0, 1),
)  # fmt: skip
CLEAR = Material(base_color=(0.9, 0.6, 0.3, 1.0), roughness=0.1, transmission=0.7, transmission_texture=TextureUse(0), specular=0.5)
COATED = Material(
    base_color=(0.6, 0.3, 0.2, 1.0), roughness=0.8, clearcoat=0.9, clearcoat_texture=TextureUse(0),
    clearcoat_roughness=0.7, clearcoat_roughness_texture=TextureUse(0, 1),
)  # fmt: skip
TILTED = replace(
    COATED, metallic=0.5, normal_texture=TextureUse(0, transform=TURNED), normal_scale=0.4,
    clearcoat_normal_texture=TextureUse(0), clearcoat_normal_scale=0.3,
)  # fmt: skip
ROUGH = replace(CLEAR, roughness=0.6, clearcoat=0.7, clearcoat_roughness=0.4)
SOLID = replace(ROUGH, thickness=1.0, metallic=0.2)
BARE = Material(base_color=(0.5, 1.0, 0.25, 1.0), base_color_texture=TextureUse(0), unlit=True)


LOOKS = ["tinted", "clear", "rough", "solid", "unlit", "coated", "tilted"]


@pytest.mark.skipif(not library.is_installed() or not library.llvm_library(), reason="mitsuba is an optional extra, and needs LLVM")
@pytest.mark.parametrize("material", [TINTED, CLEAR, ROUGH, SOLID, BARE, COATED, TILTED], ids=LOOKS)
def test_mitsuba_agrees(material: Material) -> None:
    """Under an even sky and a sun from aside, pixel by pixel."""
    sun = PunctualLight(kind="directional", direction=(-0.6, -0.3, -np.sqrt(0.55)), color=(2.0, 2.0, 2.0))
    texels = image_of(NORMALS if material.normal_texture else TEXELS)
    whole = scene([[square()]], [material], [EYE], textures=[texels], punctual=[sun])
    ours, theirs = (
        KitRig(whole, load_renderer(name), 4).render("voronoi", 1, width=4, height=4, samples=1024, depth=3, sky=(1.0, 1.0, 1.0))
        for name in ("embree", "mitsuba")
    )
    error = 5 * np.sqrt(ours.variance + theirs.variance) + 2e-3
    assert (np.abs(ours.beauty - theirs.beauty) < error).all(), (ours.beauty - theirs.beauty, error)
