"""If this fails, half an import becomes visible, an import cannot be repeated, or tables point at the wrong records."""

from __future__ import annotations

from pathlib import Path

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import LocalFault, Unreachable
from scenefold.base.ids import SceneId
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.importing import prepare_import, scene_name_of, store_import
from scenefold.client.progress import ProgressState, no_progress
from scenefold.client.scene import Scene
from scenefold.client.sealing import SceneIdentity
from scenefold.client.verifying import WriterKey
from scenefold.crypto import SigningKey
from scenefold.scene.layout import GEOMETRY, META
from scenefold.scene.log import EpochKeys
from scenefold.scene.tables import SceneTables
from scenefold.wire import PutItem, PutOutcome
from unit.client.fake_nodes import FakeNodes

WRITER = SigningKey(bytes(31) + b"\1")
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def _scene(nodes: FakeNodes) -> Scene:
    identity = SceneIdentity(SceneId(9), bytes(32), 1, {WRITER.key_id: WriterKey.always(WRITER.public)}, EpochKeys.only(bytes(24)))
    return Scene(SceneAccess(nodes.calls(), "kitchen", identity, WRITER, session=1))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "tetrahedron.obj"
    path.write_text(TETRAHEDRON)
    return path


async def _triangles(scene: Scene) -> int:
    """Of all atoms, found from the scene document alone."""
    content = await scene.content()
    assert content is not None
    payloads = [await scene.space(space).get(location) for space, location in content.locations()]
    tables = SceneTables.from_payloads(content, payloads)
    total = 0
    for group in range(len(tables.groups)):
        atoms = tables.group_atoms(group, await scene.space(GEOMETRY).get_many(tables.groups.locations(group)))
        total += sum(len(atom.triangles) for atom in atoms)
    return total


async def test_a_file_becomes_the_content_of_a_scene(autojump_clock: MockClock, file: Path) -> None:
    nodes, states = FakeNodes(), list[ProgressState]()
    scene = _scene(nodes)
    assert await scene.content() is None
    report = await scene.import_file(file, states.append)
    assert await _triangles(scene) == 4
    assert report.records == len(nodes.records) == sum(report.records_by_node.values())
    assert report.reused == 0
    assert (await scene.info()).document()["content_sha256"] == report.content_sha256
    assert [state.phase for state in states][:2] == ["read", "read"]
    assert any(state.done == state.total for state in states if state.phase == "geometry")


async def test_a_scene_is_imported_under_an_environment_map(autojump_clock: MockClock, file: Path, tmp_path: Path) -> None:
    sky = tmp_path / "sky.hdr"
    sky.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n" + 8 * bytes([128, 128, 128, 129]))
    scene = _scene(FakeNodes())
    await scene.import_file(file, environment=str(sky))
    content = await scene.content()
    assert content is not None and content.counts["environment"] == 8
    with pytest.raises(LocalFault):
        await scene.import_file(file, environment=tmp_path / "missing.hdr")


async def test_what_an_import_replaces_is_told_before_it_is_gone(autojump_clock: MockClock, file: Path, tmp_path: Path) -> None:
    scene, told = _scene(FakeNodes()), list[str]()
    other = tmp_path / "other.obj"
    other.write_text(TETRAHEDRON.replace("1 0 0", "2 0 0"))
    for path, told_of, replaced in ((file, [], ""), (file, ["tetrahedron.obj"], ""), (other, ["tetrahedron.obj"], "tetrahedron.obj")):
        told.clear()
        prepared = await prepare_import(scene.access.calls.world, path, no_progress)
        report = await store_import(scene.access, prepared, no_progress, replacing=lambda content: told.append(content.source))
        assert (told, report.replaced, report.document()["replaced"]) == (told_of, replaced, replaced)


async def test_an_import_stores_no_faster_than_it_is_told(autojump_clock: MockClock, file: Path) -> None:
    prepared = await prepare_import(FakeNodes().calls().world, file, no_progress)
    begun = trio.current_time()
    report = await _scene(FakeNodes()).import_file(file, bytes_per_s=None)
    quick_s, begun = trio.current_time() - begun, trio.current_time()
    await _scene(FakeNodes()).import_file(file, bytes_per_s=report.bytes / 100)
    assert trio.current_time() - begun > 20 + quick_s, "what is left for the last batch needs no waiting"
    assert prepared.totals() == (report.records, report.bytes)


async def test_progress_can_simply_be_asked_for(autojump_clock: MockClock, file: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO", "scenefold.client"):
        await _scene(FakeNodes()).import_file(file, progress=True)
    assert any(line.startswith("read: 1 of 1") for line in caplog.messages)
    caplog.clear()
    await _scene(FakeNodes()).import_file(file, progress=False)
    assert not caplog.messages


async def test_an_import_again_keeps_what_is_there(autojump_clock: MockClock, file: Path) -> None:
    nodes = FakeNodes()
    first = await _scene(nodes).import_file(file)
    again = await _scene(nodes).import_file(file)
    assert again.content_sha256 == first.content_sha256
    assert again.reused == again.records - 1
    assert len(nodes.records) == first.records


async def test_an_interrupted_import_shows_nothing_and_is_repeated(autojump_clock: MockClock, file: Path) -> None:
    class Failing(FakeNodes):
        def _put(self, address: str, item: PutItem) -> PutOutcome:
            if item.space == META:
                return PutOutcome(RejectReason.BUSY, item.location, 0)
            return super()._put(address, item)

    nodes = Failing()
    with pytest.raises(Exception, match="busy"):
        await _scene(nodes).import_file(file)
    assert nodes.records
    assert await _scene(nodes).content() is None
    whole = FakeNodes(records=nodes.records)
    report = await _scene(whole).import_file(file)
    assert report.reused == report.records - 1
    assert await _triangles(_scene(whole)) == 4


async def test_foreign_records_are_stepped_around(autojump_clock: MockClock, file: Path) -> None:
    nodes = FakeNodes()
    first = await _scene(nodes).import_file(file)
    taken = [key for key in nodes.records if key[0] != META]
    nodes.records.clear()
    for space, location in taken:
        await _scene(nodes).space(space).put(location, b"somebody else's")
    report = await _scene(nodes).import_file(file)
    assert report.reused == 0
    assert len(nodes.records) == len(taken) + first.records
    assert await _triangles(_scene(nodes)) == 4


async def test_a_bad_file_touches_nothing(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    (tmp_path / "bad.obj").write_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    for path in (tmp_path / "bad.obj", tmp_path / "missing.glb", tmp_path):
        with pytest.raises(LocalFault):
            await _scene(nodes).import_file(path)
    assert nodes.records == {}


async def test_a_node_that_goes_away_ends_the_import(autojump_clock: MockClock, file: Path) -> None:
    nodes = FakeNodes(away={"127.0.0.4"})
    with pytest.raises(Unreachable):
        await _scene(nodes).import_file(file)
    assert await _scene(FakeNodes(records=nodes.records)).content() is None


def test_names_of_scenes_from_names_of_files() -> None:
    assert scene_name_of("my kitchen (2)") == "my_kitchen__2_"
    assert scene_name_of("-.") == "scene"
    assert len(scene_name_of("x" * 300)) == 64
