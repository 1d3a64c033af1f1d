"""If this fails, nobody can repeat the measurements that the documentation quotes."""

from __future__ import annotations

import pytest

from integration.scenectl_process import scenectl
from loopback import ports_option

BENCH = ("bench", "render", "--scene", "cornell", "--size", "24x16", "--samples", "2", "--repetitions", "1")

COLD_S = 180.0
"""Where nothing is compiled yet and other tests want the cores."""


@pytest.mark.slow
@pytest.mark.timeout(200)
def test_clusters_are_compared_and_their_images_are_equal() -> None:
    ports = ports_option("127.0.0.2", "127.0.0.3")
    done = scenectl(*BENCH, "--nodes", "1,2", "--ports", ports, "--json", limit_s=COLD_S)
    assert done.code == 0, done.err
    report = done.json
    assert report["same_image"] is True
    assert [cluster["nodes"] for cluster in report["clusters"]] == [1, 2]
    one, two = report["clusters"]
    assert one["rays_passed_per_path"] == 0 < two["rays_passed_per_path"]
    assert two["bytes_per_path"] == 36 * two["rays_passed_per_path"]
    assert all(cluster["cpu_s"][phase] >= 0 for cluster in (one, two) for phase in ("start", "import", "warm_up", "render"))
    assert report["paths_per_s"] == report["one_thread"]["paths_per_s"]["median"]


@pytest.mark.timeout(200)
def test_without_clusters_there_is_a_table() -> None:
    done = scenectl(*BENCH, "--nodes", "none", limit_s=COLD_S)
    assert done.code == 0, done.err
    assert "kept end to end" in done.out.decode()


def test_a_scene_that_is_not_there() -> None:
    done = scenectl("bench", "render", "--scene", "nowhere.glb", "--nodes", "none")
    assert done.code == 1
    assert "nowhere.glb" in done.error
