"""Assembles the real world from its parts."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from scenefold.crypto import Identity
from scenefold.world.ports import Disk, Environment, Network, Ports, World
from scenefold.world.real.clock import RealClock
from scenefold.world.real.entropy import RealEntropy
from scenefold.world.real.workers import RealWorkers

if TYPE_CHECKING:
    from scenefold.world.versions import Versions

_CORES = os.cpu_count() or 1

DEFAULT_LANES: Mapping[str, int] = {
    "crypto": min(4, _CORES),
    "store": 1,  # LMDB has one writer, and a lane of one is its queue.
    "store-read": 2,
    "render": _CORES,
    "import": _CORES,
    "film": 2,  # Closing a pass must not wait for a tracer to come to an end of its batch.
}
"""How many calls of a lane run at once."""


def real_world(
    identity: Identity,
    authority_cert: bytes,
    *,
    ports: Ports | None = None,
    disk: Disk | None = None,
    lanes: Mapping[str, int] | None = None,
    versions: Versions | None = None,
) -> World:
    """The world of one node, or of a client (which needs no disk), under its identity.

    `lanes` overrides entries of DEFAULT_LANES. `versions` of the protocol: what this program takes, if not said otherwise. The disk comes from a floor above: `scenefold.store.LmdbDisk()`.
    """
    from scenefold.world.real.network import RealNetwork
    from scenefold.world.versions import TAKEN

    return _world(RealNetwork(identity, authority_cert, ports or Ports(), versions=versions or TAKEN), disk, lanes)


def offline_world(*, disk: Disk | None = None, lanes: Mapping[str, int] | None = None) -> World:
    """A world without a network, for work on one data folder (measurements, checks)."""
    from scenefold.world.real.offline import NoNetwork

    return _world(NoNetwork(), disk, lanes)


def newcomer_world(ports: Ports) -> World:
    """The world of who wants to join a cluster with these ports, and has no identity yet."""
    from scenefold.world.real.newcomers import NewcomerNetwork

    return _world(NewcomerNetwork(ports), None, None)


def _world(network: Network, disk: Disk | None, lanes: Mapping[str, int] | None) -> World:
    workers = RealWorkers({**DEFAULT_LANES, **(lanes or {})})
    return World(RealClock(), RealEntropy(), workers, network, disk or _NoDisk())


class _NoDisk:
    def open(self, _folder: Path, _tables: Sequence[str], /) -> Environment:
        raise AssertionError("this world has no disk")
