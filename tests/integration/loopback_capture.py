"""All that passes over the loopback device to and from some ports, for as long as a test looks."""

from __future__ import annotations

import socket
import struct
import threading
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

_ALL_PROTOCOLS = 0x0003
_SOL_PACKET, _STATISTICS = 263, 6
_SO_RCVBUFFORCE = 33
_OUTGOING = 4
_IPV4, _TCP, _UDP = 0x0800, 6, 17
_BUFFER_BYTES = 64 * 1024 * 1024
_SNAP_BYTES = 128 * 1024
_LOOK_S = 0.05

CARRIERS = {"tcp": _TCP, "udp": _UDP}
Flow = tuple[int, bytes, int, bytes, int]
"""Protocol, source and its port, target and its port."""


class Capture:
    """What passed, as one piece for each direction of each connection.

    `blind`: why nothing was seen; empty if one could look. `dropped`: packets that passed unseen, once it is over.
    """

    def __init__(self, ports: tuple[int, ...]) -> None:
        self.blind = ""
        self.dropped = 0
        self._ports = ports
        self._flows: dict[Flow, bytearray] = defaultdict(bytearray)

    def take(self, packet: bytes) -> None:
        """An IPv4 packet."""
        header = (packet[0] & 15) * 4
        protocol, inside = packet[9], packet[header:]
        if protocol not in (_TCP, _UDP):
            return
        source, target = struct.unpack_from(">HH", inside)
        if source in self._ports or target in self._ports:
            payload = inside[(inside[12] >> 4) * 4 :] if protocol == _TCP else inside[8:]
            self._flows[protocol, packet[12:16], source, packet[16:20], target] += payload

    def bytes_of(self, carrier: str, port: int) -> int:
        """To and from a port."""
        return sum(len(data) for flow, data in self._flows.items() if flow[0] == CARRIERS[carrier] and port in (flow[2], flow[4]))

    def found(self, marker: bytes) -> list[Flow]:
        """The directions in which these bytes passed."""
        return [flow for flow, data in self._flows.items() if marker in data]


@contextmanager
def captured(*ports: int, buffer_bytes: int = _BUFFER_BYTES) -> Iterator[Capture]:
    """What passes while this is entered. Who may not look at the device, as users other than root may not, is given a blind one."""
    capture, is_over = Capture(ports), threading.Event()
    try:
        device = _opened()
    except (PermissionError, AttributeError):
        capture.blind = "only root may capture packets on the loopback device, and only on Linux"
        yield capture
        return
    with device:
        _widen(device, buffer_bytes)
        device.bind(("lo", 0))
        device.settimeout(_LOOK_S)

        def listen() -> None:
            while True:
                try:
                    packet, (_, kind, direction, _, _) = device.recvfrom(_SNAP_BYTES)
                except TimeoutError:
                    if is_over.is_set():
                        return  # Nothing is left to be read.
                    continue
                # The device shows each packet twice, going out and coming in.
                if kind == _IPV4 and direction != _OUTGOING:
                    capture.take(packet)

        listener = threading.Thread(target=listen, name="capture")
        listener.start()
        try:
            yield capture
        finally:
            is_over.set()
            listener.join()
            _, capture.dropped = struct.unpack("II", device.getsockopt(_SOL_PACKET, _STATISTICS, 8))


def _opened() -> socket.socket:
    return socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(_ALL_PROTOCOLS))


def _widen(device: socket.socket, size: int) -> None:
    """Beyond what the system lets others have, if we may."""
    try:
        device.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, size)
    except PermissionError:
        device.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size)
