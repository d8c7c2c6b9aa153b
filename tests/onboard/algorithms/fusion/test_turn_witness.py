"""The autopilot's turn rates beside those of the inertial unit."""

from math import cos, pi

import pytest

from gloc3.messages.frames import Vector3
from gloc3_onboard.algorithms.fusion.turn_witness import TurnWitness

IMU_HZ, AUTOPILOT_HZ = 100, 25


def turning(t_s: float) -> Vector3:
    """A pitch to and fro, three times in two seconds, until 6 s; then a roll."""
    rate = 0.4 * cos(2 * pi * 1.5 * t_s)
    return (0.0, rate, 0.0) if t_s < 6.0 else (rate, 0.0, 0.0)


def first_contradiction_s(
    late_s: float, since_s: float = 4.0, shaking: float = 0.0, filtered_s: float = 0.0, until_s: float = 9.0
) -> float | None:
    """When an inertial unit is contradicted whose samples are late from a time on.

    Args:
        late_s: by so much.
        since_s: from then on.
        shaking: amplitude of a vibration that the autopilot filters away, rad/s.
        filtered_s: by so much the autopilot's filters delay its rates.
        until_s: end.
    """
    witness = TurnWitness()
    for count in range(round(until_s * IMU_HZ)):
        t_s = count / IMU_HZ
        x, y, z = turning(t_s - (late_s if t_s >= since_s else 0.0))
        shake = shaking * (-1) ** count
        witness.feel((x + shake, y - shake, z + shake), t_s)
        if count % (IMU_HZ // AUTOPILOT_HZ) == 0 and witness.contradicts(turning(t_s - filtered_s), t_s):
            return t_s
    return None


def test_samples_that_are_old_contradict_the_autopilot_in_half_a_second() -> None:
    found_s = first_contradiction_s(0.2)
    assert found_s is not None
    assert 4.0 < found_s < 4.5


@pytest.mark.parametrize("shaking", [0.0, 0.5])
@pytest.mark.parametrize("filtered_s", [0.0, 0.01, 0.03])
def test_filters_and_vibrations_do_not(shaking: float, filtered_s: float) -> None:
    assert first_contradiction_s(0.0, shaking=shaking, filtered_s=filtered_s) is None


def test_clocks_that_have_never_agreed_are_no_evidence() -> None:
    assert first_contradiction_s(0.4, since_s=-1.0) is None


def test_a_rate_that_is_repeated_with_another_position_is_heard_once() -> None:
    witness = TurnWitness()
    for count in range(300):
        t_s = count / IMU_HZ
        witness.feel(turning(t_s), t_s)
        if count % 4 == 0:
            witness.contradicts(turning(t_s), t_s)
    assert not any(witness.contradicts((0.0, 2.0, 0.0), 2.9 + 0.001 * count) for count in range(50))


def test_unsteady_rates_in_flight_are_contradicted_again_later() -> None:
    """A unit that was right for a while and is wrong again is found again."""
    witness = TurnWitness()
    found = []
    for count in range(900):
        t_s = count / IMU_HZ
        is_late = 3.0 <= t_s < 5.0 or t_s >= 7.0
        witness.feel(turning(t_s - (0.2 if is_late else 0.0)), t_s)
        if count % 4 == 0 and witness.contradicts(turning(t_s), t_s):
            found.append(t_s)
    assert 3.0 < found[0] < 3.5
    assert any(7.0 < t_s < 7.5 for t_s in found)
    assert not any(5.5 < t_s < 7.0 for t_s in found)
