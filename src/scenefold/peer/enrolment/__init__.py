"""Who may become a member, and who is one no more: tokens, certificates, orders, the door (specs/15-cluster-log.md, Enrolling).

Its modules are imported one by one, since most of the peer layer needs some of them.
"""
