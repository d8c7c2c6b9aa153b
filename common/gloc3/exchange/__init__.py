"""The data exchanger (paper §IV-A): one small interface, and the middlewares behind it.

Components see none of this: hosts publish and subscribe through `base`; `mavlink` and `zenoh` leave the process.
"""

from gloc3.exchange.base import Exchange, LocalExchange, Publisher, request

__all__ = [
    "Exchange",
    "LocalExchange",
    "Publisher",
    "acoustic",
    "base",
    "foreign",
    "mavlink",
    "request",
    "zenoh",
    "zenoh_session",
]
