"""Our own logs: any sampler's topic, as far as the log has it."""

from functools import partial
from typing import Any, Final

from gloc3_onboard.sensors.registry import SourceKind, SourceRequest
from gloc3_onboard.sensors.source_url import REPLAY


def _make(request: SourceRequest) -> Any:
    return request.replayed(partial(request.sensor.recorded, request.path, request.url.part, request.device))


SOURCES: Final = (SourceKind("mcap", (), "mcap://log.mcap#laser", _make, REPLAY, takes_part=True, is_file=True),)
