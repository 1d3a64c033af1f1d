"""Records on the line in an LMDB folder: the only door to lmdb (specs/10-store.md)."""

from scenefold.store.debts import Debt, DebtPage
from scenefold.store.digest_sums import Held, Listing
from scenefold.store.holding import StoredHolding
from scenefold.store.identity import StoreIdentity
from scenefold.store.judging import Outcome, Put, PutResult
from scenefold.store.layout import Spot
from scenefold.store.lmdb_disk import LmdbDisk
from scenefold.store.measuring import Rate, StoreRates, measure_store
from scenefold.store.reading import RangeAnswer
from scenefold.store.sealing import StoreDamaged
from scenefold.store.statistics import Counts, StoreStatistics
from scenefold.store.store import Store, open_store
from scenefold.store.versions import RangeSum, version_of
from scenefold.store.walking import Entry, Manifest, Rightful, Weighed

__all__ = [
    "Counts",
    "Debt",
    "DebtPage",
    "Entry",
    "Held",
    "Listing",
    "LmdbDisk",
    "Manifest",
    "Outcome",
    "Put",
    "PutResult",
    "RangeAnswer",
    "RangeSum",
    "Rate",
    "Rightful",
    "Spot",
    "Store",
    "StoreDamaged",
    "StoreIdentity",
    "StoreRates",
    "StoreStatistics",
    "StoredHolding",
    "Weighed",
    "measure_store",
    "open_store",
    "version_of",
]
