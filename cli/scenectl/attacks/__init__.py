"""What a hostile stranger or member does to a node, over real sockets; for `bench hostile` and tests.

Each attack goes on until it is cancelled, and counts what it did and how the node took it. None needs anything that such a
person would not have: an address; or a certificate of the cluster, which members have, and no key of any scene.
"""

from __future__ import annotations

from scenectl.attacks.attacker import Attack, Attacker
from scenectl.attacks.members import (
    byte_a_second,
    enormous_lengths,
    flood_of_requests,
    forged_records,
    malformed_packets,
    others_names,
    silent_members,
)
from scenectl.attacks.nodes import replayed_datagrams
from scenectl.attacks.strangers import forged_datagrams, garbage, handshakes, silent_strangers

ATTACKS: dict[str, Attack] = {
    "silent strangers": silent_strangers,
    "garbage": garbage,
    "handshakes": handshakes,
    "forged datagrams": forged_datagrams,
    "replayed datagrams": replayed_datagrams,
    "silent members": silent_members,
    "a byte a second": byte_a_second,
    "enormous lengths": enormous_lengths,
    "malformed packets": malformed_packets,
    "others' names": others_names,
    "forged records": forged_records,
    "flood of requests": flood_of_requests,
}

__all__ = ["ATTACKS", "Attack", "Attacker"]
