"""The wire: packets of Appendix C as frozen classes, strict codec, framing, documents. The only door to msgpack.

The byte formats are in specs/03-wire.md; the table of packets is `table.ROWS`. Names load on first use: some fifty
dataclasses cost 30 ms to make, and a command that prints its help should not pay for them.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scenefold.wire.codec import PROTOCOL_VERSION, decode_packet, encode_frame, encode_packet
    from scenefold.wire.common import Carrier, MiniStatus, Packet
    from scenefold.wire.data_packets import (
        EXPECT_ABSENT,
        AcceptData,
        EmptyData,
        GetData,
        GetMany,
        GetManyReply,
        ProposeData,
        PutItem,
        PutMany,
        PutManyReply,
        PutOutcome,
        QueryRange,
        RecordBytes,
        RecordKey,
        RejectData,
        RejectRange,
        ReturnData,
        ReturnRange,
    )
    from scenefold.wire.documents import Value, pack_value, unpack_value
    from scenefold.wire.errors import MalformedPacket, UnsupportedPacket
    from scenefold.wire.frames import FrameReader, frame
    from scenefold.wire.own_packets import (
        Fault,
        ListScenes,
        RequestTable,
        RespondTable,
        ScenesListed,
    )
    from scenefold.wire.pool_packets import (
        AcceptPoolJoin,
        RejectPoolJoin,
        RequestLocalPoolJoin,
        RequestRemotePoolJoin,
        SendRays,
    )
    from scenefold.wire.render_packets import (
        CancelJob,
        CollectPass,
        FetchImage,
        FilmPart,
        ImagePart,
        JobAnswer,
        JobEvent,
        JobState,
        JobStateReply,
        MergeFilm,
        PassCounts,
        PassSums,
        StartJob,
    )
    from scenefold.wire.scene_log_packets import (
        NO_GENESIS,
        AcceptSceneProposal,
        Ballot,
        Highest,
        KeyEntry,
        Member,
        Phase,
        ProposalId,
        ProposeSceneLog,
        RejectSceneProposal,
        RequestSceneLog,
        RespondSceneLog,
        SceneLogAnswer,
        SceneLogPublic,
        SceneMode,
        SpaceEntry,
        Want,
        WriterEntry,
    )
    from scenefold.wire.status_packets import (
        UNSIGNED,
        PingBroadcast,
        PublicKeyInfo,
        RequestPublicKey,
        RequestState,
        RespondPublicKey,
        Status,
    )
    from scenefold.wire.table import RESERVED, ROWS

_HOMES = {
    "codec": "PROTOCOL_VERSION decode_packet encode_frame encode_packet",
    "common": "Carrier MiniStatus Packet",
    "data_packets": "AcceptData EXPECT_ABSENT EmptyData GetData GetMany GetManyReply ProposeData PutItem PutMany PutManyReply PutOutcome QueryRange RecordBytes RecordKey RejectData RejectRange ReturnData ReturnRange",
    "documents": "Value pack_value unpack_value",
    "errors": "MalformedPacket UnsupportedPacket",
    "frames": "FrameReader frame",
    "own_packets": "Fault ListScenes RequestTable RespondTable ScenesListed",
    "pool_packets": "AcceptPoolJoin RejectPoolJoin RequestLocalPoolJoin RequestRemotePoolJoin SendRays",
    "render_packets": "CancelJob CollectPass FetchImage FilmPart ImagePart JobAnswer JobEvent JobState JobStateReply MergeFilm PassCounts PassSums StartJob",
    "scene_log_packets": "AcceptSceneProposal Ballot Highest KeyEntry Member NO_GENESIS Phase ProposalId ProposeSceneLog RejectSceneProposal RequestSceneLog RespondSceneLog SceneLogAnswer SceneLogPublic SceneMode SpaceEntry Want WriterEntry",
    "status_packets": "PingBroadcast PublicKeyInfo RequestPublicKey RequestState RespondPublicKey Status UNSIGNED",
    "table": "RESERVED ROWS",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    home = _HOME_OF.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(importlib.import_module(f"{__name__}.{home}"), name)
    return value


__all__ = [
    "EXPECT_ABSENT",
    "NO_GENESIS",
    "PROTOCOL_VERSION",
    "RESERVED",
    "ROWS",
    "UNSIGNED",
    "AcceptData",
    "AcceptPoolJoin",
    "AcceptSceneProposal",
    "Ballot",
    "CancelJob",
    "Carrier",
    "CollectPass",
    "EmptyData",
    "Fault",
    "FetchImage",
    "FilmPart",
    "FrameReader",
    "GetData",
    "GetMany",
    "GetManyReply",
    "Highest",
    "ImagePart",
    "JobAnswer",
    "JobEvent",
    "JobState",
    "JobStateReply",
    "KeyEntry",
    "ListScenes",
    "MalformedPacket",
    "Member",
    "MergeFilm",
    "MiniStatus",
    "Packet",
    "PassCounts",
    "PassSums",
    "Phase",
    "PingBroadcast",
    "ProposalId",
    "ProposeData",
    "ProposeSceneLog",
    "PublicKeyInfo",
    "PutItem",
    "PutMany",
    "PutManyReply",
    "PutOutcome",
    "QueryRange",
    "RecordBytes",
    "RecordKey",
    "RejectData",
    "RejectPoolJoin",
    "RejectRange",
    "RejectSceneProposal",
    "RequestLocalPoolJoin",
    "RequestPublicKey",
    "RequestRemotePoolJoin",
    "RequestSceneLog",
    "RequestState",
    "RequestTable",
    "RespondPublicKey",
    "RespondSceneLog",
    "RespondTable",
    "ReturnData",
    "ReturnRange",
    "SceneLogAnswer",
    "SceneLogPublic",
    "SceneMode",
    "ScenesListed",
    "SendRays",
    "SpaceEntry",
    "StartJob",
    "Status",
    "UnsupportedPacket",
    "Value",
    "Want",
    "WriterEntry",
    "decode_packet",
    "encode_frame",
    "encode_packet",
    "frame",
    "pack_value",
    "unpack_value",
]
