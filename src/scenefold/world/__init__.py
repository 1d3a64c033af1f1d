"""The seam to the outside, and what services talk through: ports, channels, links (design: docs/architecture.md).

Names that need the wire load on first use, so that `import scenefold.world` stays cheap.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from scenefold.world.ports import (
    Clock,
    Connection,
    ConnectionLost,
    Datagrams,
    Disk,
    DiskFailed,
    DiskFull,
    DiskSpace,
    Endpoint,
    Entropy,
    Environment,
    Network,
    Ports,
    Priority,
    ReadTransaction,
    Workers,
    World,
    WriteTransaction,
)

if TYPE_CHECKING:
    from scenefold.world.channel import Channel, open_channel
    from scenefold.world.guests import Guests
    from scenefold.world.links import Links, open_links
    from scenefold.world.quiet import QuietLog
    from scenefold.world.real import DEFAULT_LANES, newcomer_world, offline_world, real_world
    from scenefold.world.serving import Handler, serve_connection
    from scenefold.world.tasks import background_tasks, first_of, leaves
    from scenefold.world.turns import Turns

_LATE = {
    "Channel": "channel",
    "open_channel": "channel",
    "Guests": "guests",
    "Links": "links",
    "open_links": "links",
    "QuietLog": "quiet",
    "DEFAULT_LANES": "real",
    "newcomer_world": "real",
    "offline_world": "real",
    "real_world": "real",
    "Handler": "serving",
    "serve_connection": "serving",
    "background_tasks": "tasks",
    "first_of": "tasks",
    "leaves": "tasks",
    "Turns": "turns",
}

__all__ = [
    "DEFAULT_LANES",
    "Channel",
    "Clock",
    "Connection",
    "ConnectionLost",
    "Datagrams",
    "Disk",
    "DiskFailed",
    "DiskFull",
    "DiskSpace",
    "Endpoint",
    "Entropy",
    "Environment",
    "Guests",
    "Handler",
    "Links",
    "Network",
    "Ports",
    "Priority",
    "QuietLog",
    "ReadTransaction",
    "Turns",
    "Workers",
    "World",
    "WriteTransaction",
    "background_tasks",
    "first_of",
    "leaves",
    "newcomer_world",
    "offline_world",
    "open_channel",
    "open_links",
    "real_world",
    "serve_connection",
]


def __getattr__(name: str) -> Any:
    if name not in _LATE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_LATE[name]}"), name)
    globals()[name] = value
    return value
