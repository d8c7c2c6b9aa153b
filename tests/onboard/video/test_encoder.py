"""Which encoder encodes the video: the first that is there and gives each picture back at once."""

import pytest
from tests.onboard.video.test_video_streams import HEIGHT, WIDTH

from gloc3_onboard.video import encoder

av = pytest.importorskip("av")

SLOW = {"preset": "medium"}
"""x264 looks some pictures ahead then."""


@pytest.mark.parametrize(
    ("tried", "chosen"),
    [
        ({"no_such_encoder": {}, "libx264rgb": {}, "ffv1": {}}, "ffv1"),
        ({"h264_cuvid": {}, "libx265": SLOW}, encoder.SOFTWARE),
        ({}, encoder.SOFTWARE),
    ],
    ids=["the first that works", "a decoder, and one that looks ahead", "none"],
)
def test_the_first_that_gives_a_picture_back_at_once_is_taken(
    tried: dict[str, dict[str, str]], chosen: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(encoder, "ENCODERS", {**tried, encoder.SOFTWARE: encoder.ENCODERS[encoder.SOFTWARE]})
    assert encoder.first_working(av, WIDTH, HEIGHT) == chosen


def test_the_processor_encodes_where_there_is_no_hardware_for_it() -> None:
    *hardware, last = encoder.ENCODERS
    assert last == encoder.SOFTWARE
    assert all(name in av.codecs_available for name in hardware), "FFmpeg knows them"
    assert encoder.first_working(av, WIDTH, HEIGHT) in encoder.ENCODERS
