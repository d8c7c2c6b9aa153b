"""What a MAVLink link carries, told by its URL."""

from typing import Final

from gloc3.exchange.tunnel.layout import WIRE_OVERHEAD
from gloc3.exchange.tunnel.pacing import LinkBudget
from gloc3.mavlink.parser import SIGNATURE_LENGTH
from gloc3.mavlink.transport.endpoints import DEFAULT_BAUD, SERIAL_SCHEMES, parse_url

NETWORK_BIT_S: Final = 2_000_000.0
"""Taken for links over a network, whose rate is not known; the command link slows down by itself where it is less."""


def budget_of(url: str, *, is_signed: bool = False) -> LinkBudget:
    """What was said of its radio, else a serial line's baud rate, the usual one where it is not known, else what is usual.

    Raises:
        Refused: the URL is wrong.
    """
    wanted = parse_url(url)
    overhead_bytes = WIRE_OVERHEAD + (SIGNATURE_LENGTH if is_signed else 0)
    if wanted.rate_bit_s is not None or wanted.scheme in SERIAL_SCHEMES:
        return LinkBudget(rate_bit_s=float(wanted.line_bit_s or DEFAULT_BAUD), overhead_bytes=overhead_bytes)
    return LinkBudget(rate_bit_s=NETWORK_BIT_S, bits_per_byte=8.0, overhead_bytes=overhead_bytes)
