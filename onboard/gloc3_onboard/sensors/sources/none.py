"""A device that is not plugged in, of any kind: a recording of nothing."""

from typing import Final

from gloc3_onboard.sensors.registry import NOWHERE, SourceKind

SOURCES: Final = (SourceKind("none", (), NOWHERE, lambda request: request.replayed(lambda: ()), takes_place=False),)
