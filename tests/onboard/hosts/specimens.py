"""A component for processes of their own: it counts, and where a file tells it to, it dies as components do."""

import ctypes
import os
from collections.abc import Sequence
from pathlib import Path

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import Settings
from gloc3.messages.vehicle import HeightAboveGround


class TickerSettings(Settings, frozen=True):
    fate: str = ""
    """A file; when it is there, its word says how the component ends its process."""


class Ticker(SensorSampler[TickerSettings]):
    height = Output(HeightAboveGround)

    def __init__(self) -> None:
        self._fate: Path | None = None

    def initialize(self, settings: TickerSettings) -> None:
        self._fate = Path(settings.fate) if settings.fate else None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        if self._fate is not None and self._fate.exists():
            word = self._fate.read_text()
            self._fate.unlink()
            if word == "segfault":
                ctypes.string_at(0)
            elif word == "hang":  # in a library's code, which lets nobody else have the interpreter
                ctypes.PyDLL(None).sleep(60)
            else:
                os._exit(int(word))
        return [HeightAboveGround(height_m=1.0, is_valid=True)]
