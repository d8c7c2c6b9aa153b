"""Room that owners share: who has most of it makes room for a newcomer."""

from collections import Counter
from collections.abc import Hashable, Mapping
from typing import TypeVar

K = TypeVar("K", bound=Hashable)


def to_evict(owners: Mapping[K, str], newcomer: str) -> K | None:
    """Which of the entries makes room for one more of an owner, where all room is taken.

    Args:
        owners: the owner of each entry, oldest first.
        newcomer: the owner of the entry that finds no room.

    Returns:
        The newest entry of the owner who has most; None where that would not leave it more than the newcomer then has.
    """
    counts = Counter(owners.values())
    largest, count = counts.most_common(1)[0]
    if count <= counts[newcomer] + 1:
        return None
    return next(key for key in reversed([*owners]) if owners[key] == largest)
