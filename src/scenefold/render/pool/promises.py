"""Memory that the renders of a node have been promised (specs/19-jobs.md, Memory): what they take is asked for before, so that several that each
fit do not take together more than there is. Pure."""

from __future__ import annotations

from collections.abc import Callable

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.reasons import RejectReason

MIB = 1 << 20
MORE_MEMORY = "or give the nodes more memory"


class Promises:
    """All of one node."""

    def __init__(self, most: int, make_room: Callable[[], bool] = lambda: False) -> None:
        """`most`: bytes that all together may be. `make_room`: lets go of something that nobody seems to want; False if there is no such thing."""
        self.most = most
        self._make_room = make_room
        self._accounts: set[Account] = set()

    @property
    def held(self) -> int:
        """Bytes that are promised."""
        return sum(account.held for account in self._accounts)

    def account(self) -> Account:
        """One for a part in a job, or for organising one; close it at the end."""
        account = Account(self)
        self._accounts.add(account)
        return account

    def check(self, account: Account, needs: int, what: str, remedy: str) -> None:
        """LocalFault if the account would have more than a node may use; Refused (13) if it is more than the others leave."""
        while account.held + needs <= self.most < self.held + needs and self._make_room():
            continue
        may, others = f"this one may use {self.most // MIB} MiB", self.held - account.held
        if account.held + needs > self.most:
            before = f", and this render has {account.held // MIB} of them" if account.held else ""
            raise LocalFault(
                f"{what} takes some {needs // MIB} MiB of each node's memory; {may}{before}", remedy=f"{remedy}, {MORE_MEMORY}"
            )
        if self.held + needs > self.most:
            raise Refused(
                RejectReason.BUSY,
                f"{what} takes some {needs // MIB} MiB of a node's memory; {may}, and other renders have {others // MIB} of them",
                remedy=f"try again once they are done, {MORE_MEMORY}",
            )

    def forget(self, account: Account) -> None:
        """It is closed."""
        self._accounts.discard(account)


class Account:
    """What one part in a job, or one that organises it, was promised, by what for."""

    def __init__(self, promises: Promises) -> None:
        self._promises = promises
        self._for: dict[str, int] = {}

    @property
    def held(self) -> int:
        """Bytes."""
        return sum(self._for.values())

    def take(self, name: str, needs: int, what: str, remedy: str) -> None:
        """So many bytes under this name, in place of what it had; see `Promises.check`. `what` it is and a `remedy`, for whoever hears of it."""
        before = self._for.pop(name, 0)
        try:
            self._promises.check(self, needs, what, remedy)
        except (LocalFault, Refused):
            if before:
                self._for[name] = before
            raise
        self._for[name] = needs

    def give_back(self, name: str) -> None:
        """It is no longer there; nothing happens if it was not."""
        self._for.pop(name, None)

    def close(self) -> None:
        """Nothing is held any more, nor will be."""
        self._for.clear()
        self._promises.forget(self)
