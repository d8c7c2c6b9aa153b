"""Who makes room for a newcomer where all room is taken."""

from gloc3.mavlink.fair_share import to_evict


def test_the_newest_of_the_owner_who_has_most_makes_room() -> None:
    assert to_evict({1: "a", 2: "b", 3: "b", 4: "b", 5: "a"}, "c") == 4


def test_nobody_makes_room_for_one_who_would_then_have_as_much() -> None:
    assert to_evict({1: "a", 2: "b", 3: "b"}, "a") is None
    assert to_evict({1: "a", 2: "a", 3: "a"}, "a") is None
    assert to_evict({1: "a", 2: "b"}, "c") is None
