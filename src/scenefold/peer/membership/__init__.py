"""Who seems alive: statuses by datagram, tables, suspicion, probes, removal (thesis B.2.2; specs/11-peers.md).

Its modules are imported one by one, since most of the peer layer needs some of them.
"""
