"""An operator flies in a headless Chromium.

Where none is installed this is skipped; what needs none, the page and its websocket, is tested in `test_web.py`.
"""

from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from tests.groundstation.browser_journey import fly
from tests.groundstation.chromium import found

pytestmark = [pytest.mark.sockets, pytest.mark.flight]


@pytest.mark.skipif(found() is None, reason="no Chromium is installed here")
async def test_an_operator_flies_in_a_browser(tmp_path: Path) -> None:
    flown = await fly(tmp_path)
    assert flown.code == 0, flown.reported
    assert "'hop' is aborted" in flown.reported
    pixels = cv2.imdecode(np.frombuffer(flown.picture, np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 100, "letters with soft edges, a horizon, charts"
    assert {urlsplit(requested).netloc for requested in flown.requested} == {urlsplit(flown.url).netloc}, (
        "nothing from elsewhere"
    )
    assert flown.problems == []
