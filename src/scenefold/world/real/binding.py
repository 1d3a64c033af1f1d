"""What to tell a person when a port cannot be had."""

from __future__ import annotations

import errno

from scenefold.base.errors import LocalFault


def bind_fault(error: OSError, kind: str, address: str, port: int) -> LocalFault:
    """The LocalFault for a failed bind of a `kind` ("TCP", "UDP") port."""
    where = f"{address}:{port}"
    if error.errno == errno.EADDRINUSE:
        remedy = "another node or program runs there: stop it (`ss -lntup` shows it), or set other ports"
        return LocalFault(f"{kind} port {port} is in use", where=where, remedy=remedy)
    if error.errno == errno.EADDRNOTAVAIL:
        return LocalFault("this machine does not have that address", where=where, remedy="give the node an address of its own")
    if error.errno in (errno.EACCES, errno.EPERM):
        return LocalFault(f"{kind} port {port} is not allowed here", where=where, remedy="set ports above 1023")
    return LocalFault(f"{kind} port {port} cannot be opened: {error.strerror or error}", where=where)
