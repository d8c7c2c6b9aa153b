"""The stereo odometer on public pictures of a car, where they are there (GLOC3_STEREO)."""

import pytest
from tests.data_folders import REASON, STEREO
from tests.evidence.stereo_sets import SPOILED, ours, read_drive

pytestmark = [
    pytest.mark.outside,
    pytest.mark.thorough,
    pytest.mark.skipif(not (STEREO / "kitti_1").is_dir(), reason=REASON),
]


@pytest.mark.parametrize("spoiled", ["every second pair", "blur of 2.5 px", "as they are"])
def test_a_car_is_followed_to_a_percent_with_an_honest_covariance(spoiled: str) -> None:
    found = ours(SPOILED[spoiled](read_drive("kitti_1")))
    assert found["end"] < 1.06
    assert found["valid"] == 1.0
    assert 0.05 < found["square"] < 2.0
