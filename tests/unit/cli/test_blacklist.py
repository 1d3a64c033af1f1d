"""If this fails, who asks for all blacklists misses one, or takes what another node knows for a node's own word."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from scenectl import running
from scenectl.program import main
from scenefold.client import ClusterStatus, NodeState
from unit.client.test_health import ADDRESSES, arc, missing, node, status_of


def ask(monkeypatch: pytest.MonkeyPatch, *nodes: NodeState) -> int:
    """`node blacklist list --json` of a cluster with these."""

    @asynccontextmanager
    async def connected(_profile: str | None) -> AsyncIterator[Any]:
        async def status() -> ClusterStatus:
            return status_of(list(nodes))

        yield SimpleNamespace(status=status)

    monkeypatch.setattr(running, "connected", connected)
    return main(["node", "blacklist", "list", "--json"])


def test_the_blacklists_of_all_nodes_are_listed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    first, second = node(ADDRESSES[0], arc(0, 0.5)), node(ADDRESSES[1], arc(0.5, 1))
    assert ask(monkeypatch, replace(first, blacklist=("10.1.2.0/24",), blacklist_version=3), second) == 0
    assert json.loads(capsys.readouterr().out)["nodes"] == [
        {"address": ADDRESSES[0], "answers": True, "version": 3, "blacklist": ["10.1.2.0/24"]},
        {"address": ADDRESSES[1], "answers": True, "version": 0, "blacklist": []},
    ]


def test_of_one_that_does_not_answer_it_is_said_that_others_know_it_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    silent = replace(missing(ADDRESSES[1], arc(0.5, 1)), blacklist=("10.0.0.0/8",), blacklist_version=1)
    assert ask(monkeypatch, node(ADDRESSES[0], arc(0, 0.5)), silent) == 5
    told = json.loads(capsys.readouterr().out)["nodes"][1]
    assert told == {"address": ADDRESSES[1], "answers": False, "version": 1, "blacklist": ["10.0.0.0/8"]}
