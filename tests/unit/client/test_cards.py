"""If this fails, a scene is granted to somebody else than a person meant, or to nobody."""

from __future__ import annotations

import pytest

from scenefold.base.errors import UsageFault
from scenefold.client.cards import member_name
from scenefold.client.grants import role_named
from scenefold.wire import Role


@pytest.mark.parametrize(
    ("who", "name"),
    [
        ("user:ada", "user:ada"),
        ("user:ada@studio", "user:ada@studio"),
        ("node:5", "node:5"),
        ("127.0.0.2", "node:2130706434"),
        ("node:127.0.0.2", "node:2130706434"),
    ],
)
def test_users_are_named_and_nodes_by_id_or_address(who: str, name: str) -> None:
    assert member_name(who) == name


@pytest.mark.parametrize(
    "who",
    [
        "",
        "ada",
        "user:",
        "user:a/b",
        "user:" + "x" * 51,
        "node:x",
        "node:05",
        "node:0.0.0.0",
        "node:node:127.0.0.2",
        "user:127.0.0.2 ",
        "0.0.0.0",
        "user:ada\n",
        "USER:ada",
    ],
)
def test_what_names_nobody_is_refused(who: str) -> None:
    with pytest.raises(UsageFault, match="names no member"):
        member_name(who)


def test_roles_have_names() -> None:
    assert [role_named(name) for name in ("reader", "writer", "owner")] == list(Role)
    with pytest.raises(UsageFault, match="there is no role"):
        role_named("boss")
