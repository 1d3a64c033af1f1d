"""Records as a node keeps them for everybody: writes, reads, ranges (Algorithm 6; specs/18-data.md).

Its modules are imported one by one, since most of the peer layer needs some of them.
"""
