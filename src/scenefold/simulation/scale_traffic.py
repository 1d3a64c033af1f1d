"""What nodes send, by kind: counted where packets become bytes, in the process of a simulation only.

Gossip is what goes over the high-priority UDP port. Of what goes over TCP, packets that ask for an owner lease or grant one are
leases; all others of the cluster's and scenes' logs are log. Bytes are those of packets, without headers of IP, UDP and TLS.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from scenefold.wire import AcceptSceneProposal, Packet, ProposeSceneLog, RejectSceneProposal, RequestSceneLog, RespondSceneLog, Want
from scenefold.wire import encode_frame as true_encode_frame
from scenefold.world import channel, serving
from scenefold.world.ports import Ports
from scenefold.world.sim import Trace

KINDS = ("gossip", "leases", "log", "other")
_LOG = (AcceptSceneProposal, ProposeSceneLog, RejectSceneProposal, RequestSceneLog, RespondSceneLog)


@dataclass(slots=True)
class Traffic:
    """Messages and bytes of all nodes together."""

    ports: Ports
    messages: Counter[str] = field(default_factory=Counter)
    bytes: Counter[str] = field(default_factory=Counter)

    def a_node_and_second(self, nodes: int, seconds: float) -> dict[str, dict[str, float]]:
        """By kind, and in all."""
        found = {}
        for kind in ("all", *KINDS):
            messages, size = (count.total() if kind == "all" else count[kind] for count in (self.messages, self.bytes))
            found[kind] = {"messages": round(messages / nodes / seconds, 2), "bytes": round(size / nodes / seconds, 1)}
        return found

    def datagram(self, line: str) -> None:
        """One line of the trace; those of datagrams are <time> udp-send <address> <port> <address> <port> <bytes> ..."""
        words = line.split()
        if words[1] == "udp-send":
            self.add("gossip" if int(words[5]) == self.ports.high else "other", int(words[6]))

    def add(self, kind: str, size: int) -> None:
        self.messages[kind] += 1
        self.bytes[kind] += size


def kind_of(packet: Packet) -> str:
    """What a packet of TCP is for."""
    if isinstance(packet, RequestSceneLog) and packet.want is Want.LEASE:
        return "leases"
    if isinstance(packet, RespondSceneLog) and packet.answer is not None and packet.answer.nonce:
        return "leases"
    return "log" if isinstance(packet, _LOG) else "other"


@contextmanager
def counted(trace: Trace, ports: Ports) -> Iterator[Traffic]:
    """Counts everything that is sent while this lasts."""
    traffic = Traffic(ports)

    def counting(packet: Packet, *, version: int = 1) -> bytes:
        data = true_encode_frame(packet, version=version)
        traffic.add(kind_of(packet), len(data))
        return data

    modules: tuple[Any, ...] = (channel, serving)
    trace.on_line = traffic.datagram
    for module in modules:
        module.encode_frame = counting
    try:
        yield traffic
    finally:
        trace.on_line = None
        for module in modules:
            module.encode_frame = true_encode_frame
