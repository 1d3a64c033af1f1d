"""If this fails, an interruption costs all that was rendered, or a render goes on from what is not its own."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.render.film import EVERY_ROW, Film
from scenefold.render.job import RenderOptions
from scenefold.render.kept import KeptRender, asked_of, check_keepable, read_kept, write_kept
from scenefold.render.levels import Adaptive
from scenefold.render.pool.kept_film import film_size, kept_bytes, packed_film, stage_end, unpack_film
from scenefold.render.pool.request import Keep
from scenefold.render.sum_columns import FULL, PLAIN
from scenefold.render.window import Window

OPTIONS = RenderOptions(width=320, height=240, samples=64, seed=5)
FILM = bytes(range(256)) * (film_size(OPTIONS.plan, OPTIONS.columns, 320 * 240, 3) // 256)
KEPT = KeptRender(asked_of(OPTIONS), Keep(3, bytes(range(32)), "embree"), FILM)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "kitchen.kept"
    write_kept(path, KEPT)
    return path


def test_what_was_kept_is_read_and_replaced_as_a_whole(file: Path) -> None:
    assert read_kept(file, OPTIONS) == KEPT
    assert read_kept(file, replace(OPTIONS, algorithm="voronoi")) == KEPT, "how space is divided does not count"
    assert file.stat().st_mode & 0o777 == 0o600
    later = replace(KEPT, keep=replace(KEPT.keep, passes=9))
    write_kept(file, later)
    assert read_kept(file, OPTIONS) == later
    assert [path.name for path in file.parent.iterdir()] == [file.name]
    assert read_kept(file.with_name("another"), OPTIONS) is None


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (replace(OPTIONS, seed=6), "another seed"),
        (replace(OPTIONS, width=321), "another width"),
        (replace(OPTIONS, samples=65), "another samples"),
        (replace(OPTIONS, depth=3), "another depth"),
        (replace(OPTIONS, camera="left"), "another camera"),
        (replace(OPTIONS, sky=(1.0, 0.0, 0.0)), "another sky"),
        (replace(OPTIONS, layers=("direct",)), "another layers"),
        (replace(OPTIONS, crop=Window(0, 0, 5, 5)), "another crop"),
        (replace(OPTIONS, adaptive=Adaptive(0.1)), "another adaptive"),
        (replace(OPTIONS, seed=6, depth=3), "another depth and another seed"),
    ],
)
def test_what_is_of_another_image_is_named(file: Path, options: RenderOptions, what: str) -> None:
    with pytest.raises(LocalFault, match=what):
        read_kept(file, options)


def test_what_is_damaged_is_one_clear_error(file: Path) -> None:
    whole = file.read_bytes()
    step = len(whole) // 9
    for cut in (0, 10, 18, 25, 100, step, len(whole) - 1):
        file.write_bytes(whole[:cut])
        with pytest.raises(DamagedData, match=r"no kept render|damaged"):
            read_kept(file, OPTIONS)
    for at in (0, 17, 19, 40, 90, step, len(whole) - 1):
        file.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        with pytest.raises((DamagedData, LocalFault), match="kept render"):
            read_kept(file, OPTIONS)
    file.write_bytes(whole + b"1")
    with pytest.raises(DamagedData, match="damaged"):
        read_kept(file, OPTIONS)


def test_where_nothing_can_be_written_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(LocalFault, match="cannot keep the render"):
        write_kept(tmp_path / "no folder" / "kept", KEPT)
    with pytest.raises(LocalFault, match="cannot read the kept render"):
        read_kept(tmp_path, OPTIONS)


@pytest.mark.timeout(20)
def test_a_pipe_is_refused_and_never_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "kept"
    os.mkfifo(pipe)
    for look in (check_keepable, lambda path: read_kept(path, OPTIONS)):
        with pytest.raises(LocalFault, match="not a regular file"):
            look(pipe)


def test_where_nothing_can_be_kept_is_noticed_before_the_work(tmp_path: Path) -> None:
    check_keepable(tmp_path / "kept")
    with pytest.raises(LocalFault, match="cannot keep the render: File name too long"):
        check_keepable(tmp_path / ("k" * 240))
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize("columns", [PLAIN, FULL])
@pytest.mark.parametrize("with_rows", [False, True])
def test_a_film_comes_back_to_the_bit(columns: object, with_rows: bool) -> None:
    film, other = Film(7, 5, columns), Film(7, 5, columns)  # type: ignore[arg-type]
    rng = np.random.default_rng(3)
    film.rows.words[:] = rng.integers(0, 2**63, film.rows.words.shape, np.uint64)
    goes_on = rng.integers(0, 2, 35, np.uint8) if with_rows else EVERY_ROW
    assert unpack_film(packed_film(film, goes_on), other).tolist() == goes_on.tolist()
    assert (other.rows.words == film.rows.words).all()


def test_stages_grow_with_the_pace() -> None:
    assert stage_end(0, 1000, 5, None) == 20
    assert stage_end(20, 1000, 5, 2.0) == 140
    assert stage_end(20, 1000, 5, 0.001) == 40
    assert stage_end(990, 1000, 5, 2.0) == 1000


def test_who_keeps_a_film_has_two_more_of_it() -> None:
    assert kept_bytes(1000, PLAIN) == 2 * 136_000
