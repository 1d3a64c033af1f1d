"""Public scene headers: who may decide them, and how all nodes come to keep them (specs/16-scene-log.md).

Its modules are imported one by one, since most of the peer layer needs some of them.
"""
