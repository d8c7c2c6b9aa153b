"""The crash-safe store under everything that is kept on disk: records in a file, or one small file replaced whole.

What is written outlives the process at once. For a power cut the disk has to have it, which takes a card a second now and
then: a thread waits for that, nobody else, and `wait` tells whether it is so.
"""

from gloc3.store.files import AppendFile, DocumentFile, replace_file
from gloc3.store.records import MemoryRecords, RecordFile, Records, RecordStore

__all__ = ["AppendFile", "DocumentFile", "MemoryRecords", "RecordFile", "RecordStore", "Records", "replace_file"]
