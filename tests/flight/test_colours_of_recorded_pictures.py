"""Pictures are recorded in colour, and only those are coloured: it costs as much as the picture itself."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import PHOTOGRAPHED

from gloc3.messages.command_interface import CallFunction, Outcome
from gloc3.messages.envelope import Envelope
from gloc3_sitl.world.placing import WorldPlacement
from gloc3_sitl.world.texture import Image
from gloc3_sitl.world.tinter import Tinter

pytestmark = [pytest.mark.flight, ONE_STYLE]

LOGGED = """\
platform: pelican
extends: pelican
log: {camera/ground: 1}
"""


@pytest.fixture
def tinted(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The times of all pictures that are coloured."""
    times_s: list[float] = []
    coloured = Tinter.coloured

    def counted(self: Tinter, grey: Image, eye: WorldPlacement, t_s: float) -> Image:
        times_s.append(t_s)
        return coloured(self, grey, eye, t_s)

    monkeypatch.setattr(Tinter, "coloured", counted)
    return times_s


def test_the_recorded_pictures_are_in_colour_and_no_others_are_coloured(
    flight: Card, tmp_path: Path, tinted: list[float]
) -> None:
    flight.begin(PHOTOGRAPHED, platform="pelican", out=tmp_path)
    flight.await_state("up", "done", 60.0)
    files = sorted((tmp_path / "images").glob("*.jpg"))
    assert len(files) > 3
    assert len(tinted) == len(files), "the stereo camera alone has taken 15 a second"
    for file in files:
        pixels = np.asarray(cv2.imread(str(file), cv2.IMREAD_COLOR), dtype=int)
        assert np.abs(pixels[:, :, 2] - pixels[:, :, 0]).mean() > 2.0


def test_pictures_that_the_log_records_are_coloured_when_they_are_taken(
    flight: Card, tmp_path: Path, tinted: list[float]
) -> None:
    (tmp_path / "logged.yaml").write_text(LOGGED)
    flight.begin(PHOTOGRAPHED, platform=str(tmp_path / "logged.yaml"), out=tmp_path)
    seen: dict[str, list[bool]] = {}

    def see(envelope: Envelope[Any]) -> None:
        seen.setdefault(envelope.topic.rpartition("/")[2], []).append(bool(envelope.payload.bgr))

    flight.flight.exchange.subscribe("pelican/camera/*", see)
    flight.wait(2.0)
    assert len(seen["ground"]) > 20
    assert all(seen["ground"])
    assert not any(seen["front_left"] + seen["front_right"])
    assert tinted
    seen.clear()
    call = CallFunction(component="computer", function="log_topics", arguments={"topics": {"camera/front_left": True}})
    assert flight.request(call).outcome is Outcome.ACCEPTED
    flight.wait(1.0)
    assert sum(seen["front_left"]) > 10
    assert not any(seen["front_right"])
