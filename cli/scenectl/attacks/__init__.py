"""What a hostile stranger or member does to a node, over real sockets; for `bench hostile` and tests.

Each attack goes on until it is cancelled, and counts what it did and how the node took it. None needs anything that such a
person would not have: an address; or a certificate of the cluster, which members have, and no key of any scene. Liars are nodes that
own a part of the line; who is lied to reads there beside the honest client.
"""

from __future__ import annotations

from scenectl.attacks.attacker import Attack, Attacker
from scenectl.attacks.liars import answers_with_an_old_version, answers_with_garbage
from scenectl.attacks.members import (
    byte_a_second,
    enormous_lengths,
    flood_by_a_member,
    flood_of_requests,
    forged_records,
    forged_records_from_a_member,
    malformed_packets,
    old_record_again,
    others_names,
    silent_members,
)
from scenectl.attacks.nodes import replayed_datagrams
from scenectl.attacks.strangers import (
    forged_datagrams,
    forged_datagrams_from_a_members_address,
    garbage,
    handshakes,
    silent_strangers,
)

ATTACKS: dict[str, Attack] = {
    "silent strangers": silent_strangers,
    "garbage": garbage,
    "handshakes": handshakes,
    "forged datagrams": forged_datagrams,
    "forged datagrams, true address": forged_datagrams_from_a_members_address,
    "replayed datagrams": replayed_datagrams,
    "silent members": silent_members,
    "a byte a second": byte_a_second,
    "enormous lengths": enormous_lengths,
    "malformed packets": malformed_packets,
    "others' names": others_names,
    "forged records": forged_records,
    "forged records from a member": forged_records_from_a_member,
    "an old record played again": old_record_again,
    "flood of requests": flood_of_requests,
    "flood by a member": flood_by_a_member,
    "answers with garbage": answers_with_garbage,
    "answers with an old version": answers_with_an_old_version,
}

LIARS = ("answers with garbage", "answers with an old version")
"""Nodes that lie to who reads."""
BY_MEMBERS = ("forged datagrams, true address", "forged records from a member", "flood by a member", *LIARS)
"""By a member of the cluster's log, on another one."""

__all__ = ["ATTACKS", "BY_MEMBERS", "LIARS", "Attack", "Attacker"]
