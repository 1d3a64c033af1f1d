"""Datagrams between nodes, sealed for one target each, each counted once (specs/03-wire.md, Datagrams)."""

from scenefold.peer.datagrams.contents import PACKET_BYTES_MAX, Kind, unpacked
from scenefold.peer.datagrams.exchange import Exchange
from scenefold.peer.datagrams.pairing import Drop, Taken
from scenefold.peer.datagrams.sealed import SealedDatagrams

__all__ = ["PACKET_BYTES_MAX", "Drop", "Exchange", "Kind", "SealedDatagrams", "Taken", "unpacked"]
