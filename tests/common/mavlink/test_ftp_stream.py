"""A file that is read goes on in order, and little of it is kept in memory, whatever is lost in transit."""

from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.mavlink.services.files.ftp_stream import InOrder


class TakenPicture:
    def __init__(self) -> None:
        self.data = b""

    def opened(self, size: int) -> int:
        del size
        return 0

    def write(self, data: bytes) -> None:
        self.data += data


def test_what_comes_too_early_waits_for_what_is_missing() -> None:
    used = TakenPicture()
    order = InOrder(used, 0)
    assert order.put(0, b"ab")
    order.give(2)
    assert order.put(4, b"ef")
    order.give(2)
    assert used.data == b"ab"
    assert order.put(2, b"cd")
    order.give(6)
    assert used.data == b"abcdef"


def test_what_is_too_much_to_be_kept_is_turned_down_but_never_what_is_next() -> None:
    used = TakenPicture()
    order = InOrder(used, 10, ahead_bytes=4)
    assert order.put(12, b"cdef")
    assert not order.put(16, b"g")
    assert order.put(0, b"old"), "what is here already needs no room"
    assert order.put(10, b"ab")
    order.give(16)
    assert used.data == b"abcdef"
    assert order.put(16, b"g")


@settings(max_examples=60)
@given(st.permutations(range(12)), st.lists(st.integers(0, 11), max_size=8), st.integers(2, 60))
def test_any_order_with_repetitions_gives_the_file(places: list[int], again: list[int], room: int) -> None:
    content = bytes(range(60))
    used, come = TakenPicture(), set[int]()
    order = InOrder(used, 0, ahead_bytes=room)
    waiting = [*places, *again]
    for _ in range(200):
        if not waiting:
            break
        place = waiting.pop(0)
        if order.put(place * 5, content[place * 5 : place * 5 + 5]):
            come.add(place)
        else:
            waiting.append(place)
        whole = next((n for n in range(12) if n not in come), 12)
        order.give(whole * 5)
        assert content.startswith(used.data)
    assert used.data == content
