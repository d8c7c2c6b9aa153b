"""The data exchanger (paper §IV-A): one small interface, and the middlewares behind it."""

from gloc3.exchange.base import Exchange, Publisher, request
from gloc3.exchange.local import LocalExchange

__all__ = ["Exchange", "LocalExchange", "Publisher", "request"]
