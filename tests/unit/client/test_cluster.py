"""If this fails, a program that asks a node and orders it about in one breath does one of the two, and does not know which."""

from __future__ import annotations

from typing import Any

import pytest

from scenefold.base.errors import UsageFault
from scenefold.base.prefixes import address_prefix
from scenefold.client.cluster import Cluster


async def test_nothing_is_put_on_a_blacklist_and_taken_off_it_at_once() -> None:
    nobody_is_asked: Any = None
    rack = address_prefix("10.1.2.0/24")
    with pytest.raises(UsageFault, match=r"10\.1\.2\.0/24 cannot be put on a blacklist and taken off it at once"):
        await Cluster.blacklist(nobody_is_asked, "127.0.0.2", add=[rack], remove=[rack])


async def test_a_node_is_asked_whether_it_may_leave_or_told_to_stay() -> None:
    nobody_is_asked: Any = None
    with pytest.raises(UsageFault, match="not both at once"):
        await Cluster.drain(nobody_is_asked, "127.0.0.2", check_only=True, cancel=True)
