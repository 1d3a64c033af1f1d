"""The changes that repair makes of findings (specs/21-verify.md)."""

from __future__ import annotations

from functools import partial

from scenefold.store.checking.findings import Fix
from scenefold.world.ports import WriteTransaction


def put(table: str, key: bytes, value: bytes) -> Fix:
    """A change that writes a value."""
    return partial(_put, table=table, key=key, value=value)


def delete(table: str, key: bytes) -> Fix:
    """A change that deletes one."""
    return partial(_delete, table=table, key=key)


def _put(transaction: WriteTransaction, table: str, key: bytes, value: bytes) -> None:
    transaction.put(table, key, value)


def _delete(transaction: WriteTransaction, table: str, key: bytes) -> None:
    transaction.delete(table, key)
