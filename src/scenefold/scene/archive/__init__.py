"""A scene in one file that needs no cluster to be read: a tar of JSON and payloads (specs/24-archive.md).

    new = NewArchive(path); new.begin(scene); new.add(records) ...; new.finish()
    archive = Archive(path); archive.scene; for records in archive.batches(): ...

Both read and write files, so they belong in a worker thread.
"""

from scenefold.scene.archive.layout import BATCH, ArchivedRecord, ArchivedScene, ArchivedSpace, Totals, position_after
from scenefold.scene.archive.reading import Archive
from scenefold.scene.archive.writing import NewArchive, check_free

__all__ = [
    "BATCH",
    "Archive",
    "ArchivedRecord",
    "ArchivedScene",
    "ArchivedSpace",
    "NewArchive",
    "Totals",
    "check_free",
    "position_after",
]
