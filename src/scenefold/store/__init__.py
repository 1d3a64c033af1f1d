"""Records on the line in an LMDB folder: the only door to lmdb (specs/10-store.md)."""

from scenefold.store.identity import StoreIdentity
from scenefold.store.judging import Outcome, Put, PutResult
from scenefold.store.lmdb_disk import LmdbDisk
from scenefold.store.measuring import Rate, StoreRates, measure_store
from scenefold.store.statistics import Counts, StoreStatistics
from scenefold.store.store import RangeAnswer, Store, open_store

__all__ = [
    "Counts",
    "LmdbDisk",
    "Outcome",
    "Put",
    "PutResult",
    "RangeAnswer",
    "Rate",
    "Store",
    "StoreIdentity",
    "StoreRates",
    "StoreStatistics",
    "measure_store",
    "open_store",
]
