"""If these failed, a small glTF could take any time or memory: what many parts of it name would be read for each of them."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import pytest

from scenefold.base.errors import LocalFault
from scenefold.scene.importers import gltf_file, images, read_scene
from scenefold.scene.importers.gltf_file import GltfFile
from scenefold.scene.importers.gltf_materials import GltfMaterials
from scenefold.scene.importers.gltf_nodes import Names
from scenefold.scene.importers.source import NotCarried
from unit.scene.gltf_maker import Maker, png

MANY = 40


def wearing_one_image(maker: Maker, image: dict[str, Any], images: int = 1) -> None:
    for _ in range(images):
        maker.add("textures", source=maker.add("images", **image))
    for number in range(MANY):
        texture = {"index": number % images}
        maker.add("materials", pbrMetallicRoughness={"baseColorTexture": texture, "metallicRoughnessTexture": texture})


def materials_of(path: Path) -> tuple[GltfFile, GltfMaterials]:
    file = GltfFile(path)
    return file, GltfMaterials(file, NotCarried())


@pytest.mark.parametrize("images", [1, 3])
def test_bytes_of_a_file_count_once_however_many_name_it(tmp_path: Path, images: int) -> None:
    content = png(size=(64, 64))
    (tmp_path / "a.png").write_bytes(content)
    maker = Maker()
    wearing_one_image(maker, {"uri": "a.png"}, images)
    path = maker.write(tmp_path)
    file, _ = materials_of(path)
    assert file.bytes_read == path.stat().st_size + len(content)


def test_other_names_of_a_file_add_no_bytes(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "a.bin").write_bytes(bytes(1000))
    (tmp_path / "inner" / "b.bin").hardlink_to(tmp_path / "a.bin")
    maker = Maker()
    for uri in ("a.bin", "./a.bin", "inner/../a.bin", "inner/b.bin"):
        maker.add("buffers", byteLength=1000, uri=uri)
    path = maker.write(tmp_path)
    file = GltfFile(path)
    for number in range(4):
        file.buffer(number)
    assert file.bytes_read == path.stat().st_size + 1000


def test_a_file_of_an_image_is_opened_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.png").write_bytes(png())
    maker = Maker()
    wearing_one_image(maker, {"uri": "a.png"}, 3)
    path = maker.write(tmp_path)
    opened: list[Path] = []
    mapped = gltf_file._mapped
    monkeypatch.setattr(gltf_file, "_mapped", lambda path: opened.append(path) or mapped(path))
    _, materials = materials_of(path)
    assert len(materials.textures.list.textures) == 6 and opened == [path, tmp_path / "a.png"]


def test_base64_of_an_image_is_decoded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    maker = Maker()
    wearing_one_image(maker, {"uri": "data:image/png;base64," + base64.b64encode(png()).decode()}, 3)
    path = maker.write(tmp_path)
    decoded: list[int] = []
    real = base64.b64decode
    monkeypatch.setattr(gltf_file.base64, "b64decode", lambda data, **more: decoded.append(len(data)) or real(data, **more))
    _, materials = materials_of(path)
    assert len(materials.textures.list.textures) == 6 and len(decoded) == 1


def test_an_image_within_a_buffer_is_not_copied_for_each_that_names_it(tmp_path: Path) -> None:
    maker = Maker()
    wearing_one_image(maker, {"bufferView": maker.view(png())})
    file, materials = materials_of(maker.write(tmp_path))
    first, second = (
        materials.textures._image(entry.inner("pbrMetallicRoughness").inner("baseColorTexture"))
        for entry in file.json.maps("materials")[:2]
    )
    assert first is not None and second is not None and first[1] is second[1]


def test_cameras_of_one_name_are_numbered_without_counting_from_the_start() -> None:
    class Asked(set[str]):
        times = 0

        def __contains__(self, name: object) -> bool:
            self.times += 1
            return super().__contains__(name)

    names, asked = Names(), Asked()
    names._taken = asked
    assert [names.unused(name) for name in ("eye 3", "eye", "eye", "eye", "eye 3")] == ["eye 3", "eye", "eye 2", "eye 4", "eye 3 2"]
    assert [names.unused("eye") for _ in range(1000)][-1] == "eye 1004"
    assert asked.times < 3000


@pytest.mark.parametrize("kind", ["gltf", "obj"])
def test_more_pixels_in_all_than_any_scene_has_are_refused_before_they_are_decoded(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded: list[int] = []
    real = images.rgba_of
    monkeypatch.setattr(images, "rgba_of", lambda image, content: decoded.append(len(content)) or real(image, content))
    monkeypatch.setattr(images, "TEXTURE_PIXELS_ALL_MAX", 3 * 15)
    if kind == "gltf":
        maker = Maker()
        wearing_one_image(maker, {"bufferView": maker.view(png(size=(5, 3)))}, 4)
        maker.node(mesh=maker.mesh())
        path = maker.write(tmp_path)
    else:
        for number in range(4):
            (tmp_path / f"{number}.png").write_bytes(png(size=(5, 3)))
        (tmp_path / "m.mtl").write_text("".join(f"newmtl {number}\nmap_Kd {number}.png\n" for number in range(4)))
        path = tmp_path / "a.obj"
        path.write_text("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(LocalFault, match="more than 45 pixels in all") as caught:
        read_scene(path)
    assert str(path.parent) in str(caught.value) and caught.value.remedy == "make its images smaller, or fewer"
    assert len(decoded) == 3
