"""Targets of logs: finished, cut off, damaged, or somebody else's."""

from contextlib import suppress
from pathlib import Path
from typing import Final

from tests.fuzz.target import as_file, fuzz_target, refuses

from gloc3.log.info import summarize
from gloc3.log.payloads import PayloadDecoder
from gloc3.log.reader import LogReader
from gloc3.log.recover import recover
from gloc3.log.scan import Scan
from gloc3.log.writer import MAGIC
from gloc3.messages.topics import TopicTable

TOPICS: Final = TopicTable.installed()
TYPES: Final = sorted(TOPICS.types, key=lambda one: one.__name__)


@fuzz_target("gloc3.log")
def mcap_file(data: bytes) -> None:
    """Any bytes are scanned, read and recovered as far as they are a log; what is recovered is finished and whole."""
    for given in (data, MAGIC + data):
        assert len(list(Scan(given).raw_messages())) <= len(given)
        path = as_file(given, "log.mcap")
        target = path.with_name("recovered.mcap")
        target.unlink(missing_ok=True)

        def whole(given: bytes = given, path: Path = path, target: Path = target) -> None:
            with LogReader(path) as reader:
                entries, frames = list(reader.entries()), list(reader.frames())
                assert len(entries) + len(frames) <= len(given)
                reader.losses()
                summarize(reader, TOPICS)
            recover(path, target)
            with LogReader(target) as recovered:
                assert recovered.is_finished
                assert list(recovered.entries()) == entries

        refuses(whole)


@fuzz_target("gloc3.log.payloads")
def log_payload(data: bytes) -> None:
    """The record of any message is restored, or kept as what it is with the reason."""
    if not data:
        return
    for kind in (None, TYPES[data[0] % len(TYPES)]):
        with suppress(ValueError, RecursionError):  # declared: the reader counts it as unreadable
            PayloadDecoder(kind).decode(data[1:])
