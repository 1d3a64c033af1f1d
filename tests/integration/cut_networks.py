"""A network that a test can cut in two: each node in a network namespace of its own, and all on a switch that lives in one more.

Nothing of it touches the network of the machine. What is cut is silent: packets leave, and arrive nowhere.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import pytest

FIRST_ADDRESS = "10.77.0.2"
VARIABLE = "SCENEFOLD_TEST_NETWORK"
SIDES = ("here", "there")


def place_of(network: str, address: str) -> str:
    """The namespace of a node."""
    return f"{network}-{address.rpartition('.')[2]}"


def within(network: str, address: str, command: Sequence[str]) -> list[str]:
    """A command as it is to be run on a node's machine."""
    return ["ip", "netns", "exec", place_of(network, address), *command]


class CutNetwork:
    """Made by `cut_network`."""

    def __init__(self, name: str, addresses: Sequence[str]) -> None:
        self.name, self.addresses = name, addresses
        self._switch = f"{name}-switch"

    def make(self) -> None:
        _ip("netns", "add", self._switch)
        for side in SIDES:
            _ip("-n", self._switch, "link", "add", side, "type", "bridge")
            _ip("-n", self._switch, "link", "set", side, "up")
        for address in self.addresses:
            place = place_of(self.name, address)
            _ip("netns", "add", place)
            _ip("-n", place, "link", "add", "wire", "type", "veth", "peer", "name", address, "netns", self._switch)
            _ip("-n", place, "addr", "add", f"{address}/24", "dev", "wire")
            for device in ("wire", "lo"):
                _ip("-n", place, "link", "set", device, "up")
            _ip("-n", self._switch, "link", "set", address, "master", SIDES[0], "up")

    def remove(self) -> None:
        for place in (*(place_of(self.name, address) for address in self.addresses), self._switch):
            subprocess.run(["ip", "netns", "del", place], capture_output=True, check=False)

    def cut_off(self, *addresses: str) -> None:
        """These reach one another, and nobody else."""
        for address in addresses:
            _ip("-n", self._switch, "link", "set", address, "master", SIDES[1])

    def heal(self) -> None:
        for address in self.addresses:
            _ip("-n", self._switch, "link", "set", address, "master", SIDES[0])

    def on(self, address: str, *command: str) -> list[str]:
        """A command as it is to be run on a node's machine."""
        return within(self.name, address, command)


@contextmanager
def cut_network(count: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[CutNetwork]:
    """For nodes at `FIRST_ADDRESS` and up, run by `integration.apart_node`. Skips where this machine does not allow it."""
    first, _, last = FIRST_ADDRESS.rpartition(".")
    network = CutNetwork(f"scenefold-{os.getpid()}", [f"{first}.{int(last) + index}" for index in range(count)])
    monkeypatch.setenv(VARIABLE, network.name)
    try:
        try:
            network.make()
        except (OSError, subprocess.CalledProcessError) as problem:
            words = problem.stderr.decode().strip() if isinstance(problem, subprocess.CalledProcessError) else str(problem)
            pytest.skip(f"no network namespaces with a bridge here: {words}; tests/simulation/test_log_cut.py cuts a simulated network")
        yield network
    finally:
        network.remove()


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], capture_output=True, check=True)
