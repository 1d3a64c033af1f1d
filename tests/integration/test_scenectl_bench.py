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
@pytest.mark.long
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


@pytest.mark.timeout(120)
def test_what_a_cluster_stores_a_second_is_measured_and_its_copies_are_counted() -> None:
    ports = ports_option("127.0.0.2", "127.0.0.3", "127.0.0.4")
    sizes = "--mib", "2", "--small-records", "130"
    done = scenectl("bench", "store", "--nodes", "3", "--copies", "3", *sizes, "--ports", ports, "--json", limit_s=COLD_S)
    assert done.code == 0, done.err
    report = done.json
    rates = ("write_mib_s", "read_mib_s", "small_writes_per_s", "small_reads_per_s", "cpu_s_per_mib", "read_cpu_s_per_mib", "copied_mib_s")
    assert all(report[key] > 0 for key in rates)
    assert 0 < report["p50_ms"] <= report["p99_ms"]
    assert (report["nodes"], report["copies"], report["copies_min"], report["copies_found"]) == (3, 3, 2, 3.0)
    assert 1.9 < report["mib"] <= 2 and report["small_records"] == 130


def test_more_copies_to_be_waited_for_than_there_shall_be() -> None:
    done = scenectl("bench", "store", "--nodes", "1", "--copies", "2", "--min-copies", "3", "--ports", ports_option("127.0.0.2"))
    assert done.code == 2 and "3 of 2" in done.error


@pytest.mark.slow
@pytest.mark.timeout(240)
@pytest.mark.long
def test_three_participants_are_measured_and_go_on_without_who_proposed() -> None:
    ports = ports_option("127.0.0.2", "127.0.0.3", "127.0.0.4")
    sizes = "--participants", "3", "--commits", "4", "--clients", "2", "--kills", "1"
    done = scenectl("bench", "log", *sizes, "--simulated", "3", "--ports", ports, "--json", limit_s=COLD_S)
    assert done.code == 0, done.err
    (row,), (simulated,) = done.json["participants"], done.json["simulated"]
    turns = [row[way] for way in ("one_client", "one_scene", "a_scene_each")]
    assert row["participants"] == 3
    assert all(turn["commits"] + turn["refused"] + turn["unknown"] == 4 for turn in turns)
    assert all(0 < turn["p50_ms"] <= turn["p99_ms"] and turn["cpu_ms_per_commit"] > 0 for turn in turns)
    assert row["one_client"]["commits"] == 4 and simulated["packets_per_commit"] == 6
    assert row["one_client"]["packets_per_commit"] > 5, "the news of the last may be on its way yet"
    assert row["killed"]["kills"] == len(row["killed"]["next_commit_s"]) == 1
    assert 0 < row["killed"]["next_commit_s"][0] < 60
