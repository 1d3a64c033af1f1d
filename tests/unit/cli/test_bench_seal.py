"""If this fails, `bench seal` compares unlike things, or leaves out a suite, a size or a work."""

from __future__ import annotations

import json
from typing import get_args

import pytest
from nacl.exceptions import BadSignatureError

from scenectl.bench_seal import WORKS, _works
from scenectl.program import main
from scenectl.values import DEFAULT_SUITE, SuiteOption
from scenefold.crypto import ED25519, RSA3072, SUITE_NAMES, suite_named
from unit.crypto.suites_made import SIGNING

TINY = ["bench", "seal", "--records", "2", "--rounds", "1"]


def test_every_suite_size_and_number_of_threads_is_measured(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*TINY, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    cases = [(result["suite"], result["payload_bytes"], result["cores"]) for result in report["results"]]
    names = ("ed25519-aes192gcm", "rsa3072-aes192gcm")
    assert cases == [(name, size, cores) for name in names for size in (61440, 1024) for cores in (1, 2)]
    assert report["ratio_to_bare_60kib"] == report["results"][0]["ratio_to_bare"]
    for result in report["results"]:
        assert tuple(result["works"]) == WORKS
        assert all(work["ratio"] > 0 and work["records_per_second"]["median"] > 0 for work in result["works"].values())
    assert all(work["gain"] == 1 for work in report["results"][0]["works"].values())


def test_for_people_there_is_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*TINY, "--threads", "1"]) == 0
    assert "of the bare calls" in capsys.readouterr().out


@pytest.mark.parametrize("suite", [ED25519, RSA3072])
def test_ours_and_bare_do_the_same_number_of_real_ones(suite: int) -> None:
    works = {work.name: work for work in _works(SIGNING[suite], 1024, 3)}
    assert set(works) == {f"{prefix}{name}" for name in WORKS for prefix in ("", "bare ")}
    assert {work.items for work in works.values()} == {3}
    for work in works.values():
        work.run()


def test_bare_verifying_does_verify() -> None:
    """A bare call that gives up early would flatter nobody but the library."""
    works = {work.name: work for work in _works(SIGNING[ED25519], 1024, 3)}
    bare = works["bare verify"].run.args[1].__self__  # type: ignore[attr-defined]
    bare._signed = [(header[:-1] + b"\0", *others) for header, *others in bare._signed]
    with pytest.raises(BadSignatureError):
        works["bare verify"].run()


def test_the_suites_that_can_be_chosen_are_those_of_the_registry() -> None:
    assert get_args(SuiteOption) == SUITE_NAMES and suite_named(DEFAULT_SUITE).number == ED25519
