"""The cluster's own log: its fold, this node's copy, the voter, and the leases that come with it (specs/15-cluster-log.md).

Its modules are imported one by one, since most of the peer layer needs some of them.
"""
