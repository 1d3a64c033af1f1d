"""Every bound of the system with its reason. Relations between bounds are asserted at the end."""

from __future__ import annotations

PAYLOAD_BYTES_MAX = 60 * 1024
"""Payload of one record: what fits a UDP datagram with its header (storage.md)."""
FRAME_BYTES_MAX = 8 * 1024 * 1024
"""One frame on a TCP connection, checked before allocation."""
DATAGRAM_BYTES_MAX = 1400
"""A status datagram stays below common path MTUs."""
PASS_PATHS_MAX = 65_536
"""Paths of one pass: their index is 16 bits in the ray record."""
RAY_BATCH_MAX = 60 * 1024 // 36
"""Rays of one packet: 60 KiB of 36-byte records."""
ATOM_TRIANGLES_MAX = 1_000
"""Triangles of a geometry atom, so that it fits one record."""
GROUP_TRIANGLES_TARGET = 8_000
"""Triangles of a group, the unit of paging and of what a cell holds."""
SPACE_DIMENSIONS_MAX = 8
"""Three bits on the wire hold dimensions minus one."""
NODES_MAX = 127
"""Nodes of one cluster that the partition kernels and the tests cover."""
PORT_LOW_PRIORITY = 17349
"""Data, rays, images; UDP and TCP."""
PORT_HIGH_PRIORITY = 17350
"""Status, scene log, pools; UDP and TCP."""

assert PAYLOAD_BYTES_MAX < FRAME_BYTES_MAX
assert RAY_BATCH_MAX * 36 <= PAYLOAD_BYTES_MAX
