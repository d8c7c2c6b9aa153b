"""Crash-safe storage on disk: records in a file, or one small file that is replaced as a whole.

Written data survives the process at once. To survive a power cut it has to be on disk, which sometimes takes an SD card
a second: only a thread waits for that, and `wait` returns whether it is done.
"""

from gloc3.store.files import AppendFile, DocumentFile, replace_file, replace_link, write_secret
from gloc3.store.records import MemoryRecords, RecordFile, Records, RecordStore

__all__ = [
    "AppendFile",
    "DocumentFile",
    "MemoryRecords",
    "RecordFile",
    "RecordStore",
    "Records",
    "replace_file",
    "replace_link",
    "write_secret",
]
