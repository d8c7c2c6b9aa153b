"""Who may connect while handshakes are not complete: limits of an address and of all, and how long failures count."""

import pytest

from gloc3.exchange.admission import KNOWN, OF_ADDRESS, OF_ALL, Admission, caller_of

MOST, HELD_S = OF_ADDRESS
MOST_OF_ALL, HELD_OF_ALL_S = OF_ALL


def test_an_address_has_so_many_connections_without_a_handshake_and_others_are_not_affected() -> None:
    admission = Admission()
    assert [admission.enter("a", 0.0) for _ in range(MOST + 1)] == [True] * MOST + [False]
    assert admission.enter("b", 0.0)


def test_a_complete_handshake_frees_its_place_at_once_and_a_failed_one_later() -> None:
    admission = Admission()
    for _ in range(MOST):
        admission.enter("a", 0.0)
    admission.leave("a", 1.0, is_complete=True)
    assert admission.enter("a", 1.0)
    admission.leave("a", 2.0, is_complete=False)
    assert not admission.enter("a", 2.0)
    assert not admission.enter("a", 1.9 + HELD_S)
    assert admission.enter("a", 2.0 + HELD_S)


def test_strangers_share_a_limit_beyond_which_only_known_addresses_are_admitted() -> None:
    admission = Admission()
    admission.enter("known", 0.0)
    admission.leave("known", 0.0, is_complete=True)
    assert [admission.enter(f"s{n}", 0.0) for n in range(MOST_OF_ALL + 1)] == [True] * MOST_OF_ALL + [False]
    assert admission.enter("known", 0.0)
    admission.leave("known", 0.0, is_complete=True)
    for number in range(MOST_OF_ALL):
        admission.leave(f"s{number}", 1.0, is_complete=False)
    assert not admission.enter("new", 1.0)
    assert admission.enter("known", 1.0)
    assert admission.enter("new", 1.0 + HELD_OF_ALL_S)


def test_only_so_many_addresses_are_remembered_those_that_connected_last() -> None:
    admission = Admission()
    for number in range(KNOWN + 1):
        assert admission.enter(f"m{number}", 0.0)
        admission.leave(f"m{number}", 0.0, is_complete=True)
    for number in range(MOST_OF_ALL):
        admission.enter(f"s{number}", 0.0)
    assert not admission.enter("m0", 0.0)
    assert admission.enter("m1", 0.0)


@pytest.mark.parametrize(
    ("address", "caller"),
    [
        ("10.88.0.3", "10.88.0.3"),
        ("::ffff:10.88.0.3", "10.88.0.3"),
        ("2001:db8:1:2:aaaa::7", "2001:db8:1:2::/64"),
        ("2001:db8:1:2:bbbb::9", "2001:db8:1:2::/64"),
        ("fe80::1%eth0", "fe80::1"),
        ("::1", "::1"),
    ],
)
def test_a_computer_is_its_ipv4_address_or_its_network_of_ipv6(address: str, caller: str) -> None:
    assert caller_of(address) == caller
