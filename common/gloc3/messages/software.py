"""Software version and protocol hash of an end, and the compatibility of two ends."""

from functools import cache
from hashlib import blake2s
from typing import Final, NamedTuple

from gloc3 import __version__
from gloc3.messages.envelope import SignedMessage
from gloc3.messages.preflight import Check, Group, Verdict
from gloc3.messages.topics import TopicTable
from gloc3.messages.wire import type_name

DIGEST_BYTES: Final = 4


class Software(NamedTuple):
    """Software that an end reports; empty texts from one that does not."""

    version: str
    protocol: str
    """Over the fixed parts of the types of all our topics, those of other packages and inner ones left out."""

    def __str__(self) -> str:
        return f"{self.version} ({self.protocol})"


@cache
def own_software() -> Software:
    """This end."""
    from gloc3.messages.standard_topics import TOPICS

    types = {row.message for _, row in TopicTable(TOPICS) if not row.is_inner}
    types -= {SignedMessage}  # networks alone have it, around another
    names = sorted(map(type_name, types))
    return Software(__version__, blake2s(",".join(names).encode(), digest_size=DIGEST_BYTES).hexdigest())


def compared(name: str, other: Software, where: str, group: Group = Group.LINK) -> Check:
    """Line of the pre-flight list about another end.

    Args:
        name: of the line.
        other: reported by that end.
        where: its name in the text, such as `at station 255`.
        group: of the line.
    """
    own = own_software()
    finding = f"{other} {where}, {own} here"
    if not other.version:
        advice = "install the same version at both ends, to be sure"
        return Check(group, name, Verdict.UNKNOWN, f"{where} is not reported, and {own} is here", advice)
    if other.protocol and other.protocol != own.protocol:
        advice = "they speak differently, and what one does not understand it refuses: install the same version at both"
        return Check(group, name, Verdict.RED, finding, advice)
    if other.version != own.version:
        return Check(group, name, Verdict.WARNING, finding, "install the same version at both ends")
    return Check(group, name, Verdict.OK, f"{own} {where} too")
