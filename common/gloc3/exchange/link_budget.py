"""What a MAVLink link carries, told by its URL."""

from typing import Final

from gloc3.exchange.tunnel.pacing import LinkBudget
from gloc3.link.endpoints import DEFAULT_BAUD, SERIAL_SCHEMES, parse_url

NETWORK_BIT_S: Final = 2_000_000.0
"""Taken for links over a network, whose rate is not known; the command link slows down by itself where it is less."""


def budget_of(url: str) -> LinkBudget:
    """A serial line carries its baud rate, of which the usual one is taken where it is not known; a network what is usual.

    Raises:
        Refused: the URL is wrong.
    """
    wanted = parse_url(url)
    if wanted.scheme in SERIAL_SCHEMES:
        return LinkBudget(rate_bit_s=float(wanted.baud or DEFAULT_BAUD))
    return LinkBudget(rate_bit_s=NETWORK_BIT_S, bits_per_byte=8.0)
