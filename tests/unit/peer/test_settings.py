"""If this fails, a node begins to run with settings that it cannot keep to."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from scenefold.base.errors import UsageFault
from scenefold.base.limits import BLACKLIST_MAX
from scenefold.base.location import Location
from scenefold.peer.settings import NodeSettings, place_of


def settings(**changes: Any) -> NodeSettings:
    return NodeSettings(profile_folder=Path("profile"), address="10.0.0.1", data_folder=Path("data"), **changes)


def some_addresses(count: int) -> tuple[str, ...]:
    return tuple(f"10.0.1.{number}" for number in range(1, count + 1))


def test_a_blacklist_may_be_as_long_as_a_status_can_carry() -> None:
    listed = settings(blacklist=some_addresses(BLACKLIST_MAX)).blacklisted
    assert list(map(str, listed)) == list(some_addresses(BLACKLIST_MAX))


@pytest.mark.parametrize(
    ("changes", "what", "remedy"),
    [
        ({"blacklist": some_addresses(BLACKLIST_MAX + 1)}, f"a blacklist of {BLACKLIST_MAX + 1} entries", f"give {BLACKLIST_MAX} at most"),
        ({"blacklist": ("10.0.0.2", "ada")}, "'ada' is no IPv4 address", "give an address such as"),
        (
            {"blacklist": ("10.0.0.2/24",)},
            "10.0.0.2/24 has bits set behind the first 24: the prefix is 10.0.0.0/24",
            "give an address such as",
        ),
        ({"scrub_days": 0.0}, "a scrub of 0 days", "give more than 0"),
        ({"scrub_days": float("nan")}, "a scrub of nan days", "give more than 0"),
        ({"scrub_bytes_per_s": 0}, "a scrub of 0 bytes a second", "give at least 1"),
        ({"seeds": ("10.0.0.300",)}, "'10.0.0.300' is no IPv4 address", "give one such as"),
        ({"seeds": ("0.0.0.0",)}, "0.0.0.0 is not the address of one machine", "give one such as"),
        ({"remove_after_s": 5.0}, "removal after 5 s", "give at least"),
        ({"remove_after_s": float("nan")}, "removal after nan s", "give at least"),
        ({"transfer_bytes_per_s": 0}, "transfers of 0 bytes a second", "give at least 1"),
        ({"render_threads": 0}, "0 render threads", "give a number from 1"),
    ],
)
def test_what_cannot_be_is_one_clear_error(changes: dict[str, Any], what: str, remedy: str) -> None:
    with pytest.raises(UsageFault) as caught:
        settings(**changes)
    assert caught.value.what == what and str(caught.value.remedy).startswith(remedy)


@pytest.mark.parametrize("text", ["", " ", "0x", "80 00", " 8", "8\n", "8" * 41, "8" * 42, "+8", "8_0", "fullest", "Random"])
def test_what_is_no_place_is_never_taken_for_the_beginning_of_the_line(text: str) -> None:
    with pytest.raises(UsageFault, match="no place on the line") as caught:
        place_of(text)
    assert "1 to 40 hexadecimal digits" in str(caught.value.remedy)


@pytest.mark.parametrize("text", ["8", "80", "0x80", "0X8", "8" + "0" * 39])
def test_a_place_is_its_leading_digits(text: str) -> None:
    assert place_of(text) == Location.from_number(1 << 159)


def test_places_that_have_names() -> None:
    assert (place_of("loaded"), place_of("random")) == ("loaded", "random")
    assert place_of("0") == Location(bytes(20)) and place_of("FfF") == Location(b"\xff\xf0" + bytes(18))
