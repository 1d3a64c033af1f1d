"""The table of packets: every number with its name, carrier and fields (specs/03-wire.md).

The rows stand next to the classes that they describe, one file per family; here they become one table.
A test holds it equal to the table in the spec.
"""

from __future__ import annotations

from scenefold.wire import (
    ballots,
    consensus_packets,
    copy_packets,
    custody,
    custody_packets,
    data_packets,
    enrol_packets,
    facts,
    handover_packets,
    lease_packets,
    log_records,
    log_snapshots,
    log_values,
    loss_packets,
    member_packets,
    members,
    orders,
    own_packets,
    pool_packets,
    purge_packets,
    render_packets,
    render_settings,
    scene_certificates,
    scene_headers,
    scene_log_packets,
    status_packets,
    suspect_packets,
    upkeep_packets,
)
from scenefold.wire.common import MINI_STATUS, Row
from scenefold.wire.containers import since_of

ROWS: dict[int, Row] = {
    row.number: row
    for family in (
        status_packets,
        scene_log_packets,
        consensus_packets,
        data_packets,
        pool_packets,
        own_packets,
        render_packets,
        handover_packets,
        member_packets,
        enrol_packets,
        custody_packets,
        copy_packets,
        purge_packets,
        suspect_packets,
        upkeep_packets,
        lease_packets,
        loss_packets,
    )
    for row in family.ROWS
}

RESERVED: dict[int, str] = {
    24: "of the thesis's range",
    25: "of the thesis's range",
    26: "of the thesis's range",
    27: "of the thesis's range",
    28: "of the thesis's range",
    29: "of the thesis's range",
    30: "of the thesis's range",
    31: "of the thesis's range",
    45: "PurgeRecord, which became 102",
    47: "WatchEvents",
    52: "PassCounts, which rides in 23 now",
    61: "TerminationToken",
    62: "FetchGeometry",
    63: "GeometryPart",
}
"""Numbers that are spoken for but not built: they decode to UnsupportedPacket."""

STRUCTS = (
    MINI_STATUS,
    *status_packets.STRUCTS,
    *members.STRUCTS,
    *scene_headers.STRUCTS,
    *ballots.STRUCTS,
    *facts.STRUCTS,
    *log_values.STRUCTS,
    *scene_certificates.STRUCTS,
    *scene_log_packets.STRUCTS,
    *data_packets.STRUCTS,
    *handover_packets.STRUCTS,
    *custody.STRUCTS,
    *custody_packets.STRUCTS,
    *copy_packets.STRUCTS,
    *purge_packets.STRUCTS,
    *suspect_packets.STRUCTS,
    *loss_packets.STRUCTS,
    *log_records.STRUCTS,
    *render_settings.STRUCTS,
    *log_snapshots.STRUCTS,
    *orders.STRUCTS,
    *pool_packets.STRUCTS,
)
"""What stands inside packets as an array of its own."""

assert not ROWS.keys() & RESERVED.keys()
assert ROWS.keys() | RESERVED.keys() == set(range(1, 128))
assert not any(since_of(kind) for struct in STRUCTS for _, kind in struct.fields), (
    "what stands inside packets has no fields of later versions"
)
