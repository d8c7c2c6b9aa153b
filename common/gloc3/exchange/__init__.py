"""The data exchanger (paper §IV-A): one small interface, and the middlewares behind it."""

from gloc3.exchange.base import Exchange, LocalExchange, Publisher, request

__all__ = ["Exchange", "LocalExchange", "Publisher", "request"]
