"""All that passes over the loopback device to and from some ports, for as long as a test looks."""

from __future__ import annotations

import socket
import struct
import threading
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

_ALL_PROTOCOLS = 0x0003
_OUTGOING = 4
_IPV4, _TCP, _UDP = 0x0800, 6, 17
_BUFFER_BYTES = 64 * 1024 * 1024
_SNAP_BYTES = 128 * 1024
_LOOK_S = 0.05

Flow = tuple[int, bytes, int, bytes, int]
"""Protocol, source and its port, target and its port."""


class Capture:
    """What passed, as one piece for each direction of each connection."""

    def __init__(self, ports: tuple[int, ...]) -> None:
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

    def bytes_of(self, protocol: str) -> int:
        number = {"tcp": _TCP, "udp": _UDP}[protocol]
        return sum(len(data) for flow, data in self._flows.items() if flow[0] == number)

    def found(self, marker: bytes) -> list[Flow]:
        """The directions in which these bytes passed."""
        return [flow for flow, data in self._flows.items() if marker in data]


@contextmanager
def captured(*ports: int) -> Iterator[Capture]:
    """What passes while this is entered. Skips the test where one may not look at the device, as users other than root may not."""
    capture, is_over = Capture(ports), threading.Event()
    try:
        device = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(_ALL_PROTOCOLS))
    except (PermissionError, AttributeError):
        pytest.skip("only root may capture packets on the loopback device, and only on Linux")
    with device:
        device.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
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
