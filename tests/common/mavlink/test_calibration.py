"""Calibration as a machine: whatever a vehicle says, the state stays sane, and what is lost is asked for again or not."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.errors import Refused
from gloc3.mavlink.codec import message
from gloc3.mavlink.message import MavlinkMessage
from gloc3.mavlink.services.calibration import SILENT_S, Calibration, CalibrationKind, CalibrationPhase, SideState
from gloc3.mavlink.services.calibration_ardupilot import ArduPilotCalibration
from gloc3.mavlink.services.calibration_px4 import Px4Calibration

from .pair import STATION, VEHICLE

KINDS = [kind for kind in CalibrationKind if kind is not CalibrationKind.RADIO]
"""The vehicle leads these itself; the last one, the ESCs, with PX4 only."""


def begun(kind: CalibrationKind, machine: type[Calibration] = Px4Calibration) -> Calibration:
    calibration = machine(STATION, VEHICLE, kind)
    calibration.begin(0.0)
    return calibration


def text(words: str) -> MavlinkMessage:
    return message("STATUSTEXT", severity=6, text=words)


@pytest.mark.parametrize(
    ("machine", "kind", "sent"),
    [
        (Px4Calibration, CalibrationKind.GYRO, (241, 1, 0, 0, 0, 0)),
        (Px4Calibration, CalibrationKind.MAGNETOMETER, (241, 0, 1, 0, 0, 0)),
        (Px4Calibration, CalibrationKind.ACCELEROMETER, (241, 0, 0, 0, 0, 1)),
        (Px4Calibration, CalibrationKind.LEVEL, (241, 0, 0, 0, 0, 2)),
        (ArduPilotCalibration, CalibrationKind.GYRO, (241, 1, 0, 0, 0, 0)),
        (ArduPilotCalibration, CalibrationKind.MAGNETOMETER, (42424, 0, 0, 1, 0, 0)),
        (ArduPilotCalibration, CalibrationKind.ACCELEROMETER, (241, 0, 0, 0, 0, 1)),
        (ArduPilotCalibration, CalibrationKind.LEVEL, (241, 0, 0, 0, 0, 2)),
    ],
)
def test_each_kind_is_asked_for_in_its_firmwares_way(
    machine: type[Calibration], kind: CalibrationKind, sent: tuple[float, ...]
) -> None:
    (requested,) = begun(kind, machine).outgoing()
    assert (
        requested.command,
        requested.param1,
        requested.param2,
        requested.param3,
        requested.param4,
        requested.param5,
    ) == sent


def test_a_lost_command_is_sent_again_where_the_answer_comes_at_once_and_only_there() -> None:
    for machine, kind, again in (
        (Px4Calibration, CalibrationKind.GYRO, 3),
        (ArduPilotCalibration, CalibrationKind.ACCELEROMETER, 3),
        (ArduPilotCalibration, CalibrationKind.GYRO, 0),
    ):
        calibration = begun(kind, machine)
        calibration.outgoing()
        sent = 0
        for tenth in range(18):
            calibration.tick(tenth / 10)
            sent += len(calibration.outgoing())
        assert sent == again


def test_nobody_there_is_failed_in_bounded_time() -> None:
    for machine in (Px4Calibration, ArduPilotCalibration):
        calibration, now_s = begun(CalibrationKind.GYRO, machine), 0.0
        while not calibration.state.is_over:
            next_s = calibration.next_tick_s()
            assert next_s is not None
            now_s = max(now_s, next_s)
            calibration.tick(now_s)
        assert now_s <= SILENT_S
        assert calibration.state.reason == "the vehicle's answer: not answered"


def test_texts_of_other_components_and_other_vehicles_say_nothing() -> None:
    calibration = begun(CalibrationKind.GYRO)
    for sender in (STATION, VEHICLE._replace(system=2), VEHICLE._replace(component=191)):
        calibration.receive(text("[cal] calibration done: gyro"), sender, 1.0)
    calibration.receive(text("calibration done: gyro"), VEHICLE, 1.0)
    assert calibration.state.phase is CalibrationPhase.ASKED


def test_what_comes_after_the_end_changes_nothing() -> None:
    calibration = begun(CalibrationKind.GYRO)
    for words in ("[cal] calibration failed: reading sensor", "[cal] calibration done: gyro"):
        calibration.receive(text(words), VEHICLE, 1.0)
    assert (calibration.state.phase, calibration.state.reason) == (CalibrationPhase.FAILED, "reading sensor")
    calibration.cancel(2.0)
    assert calibration.state.phase is CalibrationPhase.FAILED
    with pytest.raises(Refused):
        calibration.confirm(3.0)


words = st.one_of(
    st.sampled_from(
        [
            "[cal] calibration started: 2 accel",
            "[cal] pending: back front left right up down",
            "[cal] pending:",
            "[cal] pending: sideways",
            "[cal] progress <17>",
            "[cal] progress <999>",
            "[cal] progress <>",
            "[cal] down orientation detected",
            "[cal] nowhere orientation detected",
            "[cal] down side done, rotate to a different side",
            "[cal] calibration failed: timeout: no motion",
            "[cal] calibration cancelled",
            "[cal] calibration done: accel",
            "[cal] ",
        ]
    ),
    st.text(max_size=20).map(lambda tail: f"[cal] {tail}"),
    st.text(max_size=30),
)


@settings(max_examples=80)
@given(st.lists(words, max_size=12), st.sampled_from(KINDS))
def test_no_text_brings_it_out_of_order(said: list[str], kind: CalibrationKind) -> None:
    calibration = begun(kind)
    for number, one in enumerate(said):
        calibration.receive(text(one.encode()[:49].decode(errors="ignore")), VEHICLE, number / 10)
        state = calibration.state
        assert state.progress is None or 0.0 <= state.progress <= 1.0
        assert all(side in SideState for side in state.sides.values())
    ends = [event for event in calibration.events() if event.is_over]
    assert len(ends) <= 1


@settings(max_examples=60)
@given(
    st.lists(
        st.one_of(
            st.builds(
                lambda p: message("COMMAND_LONG", target_system=255, command=42429, param1=float(p)),
                st.sampled_from([0, 1, 2, 6, 7, 16_777_215, 16_777_216, float("inf"), float("nan"), -1]),
            ),
            st.builds(
                lambda c, m, s, p: message(
                    "MAG_CAL_PROGRESS", compass_id=c, cal_mask=m, cal_status=s, completion_pct=p
                ),
                *(st.integers(0, 255),) * 4,
            ),
            st.builds(
                lambda c, m, s: message("MAG_CAL_REPORT", compass_id=c, cal_mask=m, cal_status=s),
                *(st.integers(0, 255),) * 3,
            ),
        ),
        max_size=10,
    ),
    st.sampled_from(KINDS[:-1]),
)
def test_no_message_brings_it_out_of_order(said: list[MavlinkMessage], kind: CalibrationKind) -> None:
    calibration = begun(kind, ArduPilotCalibration)
    for number, one in enumerate(said):
        calibration.receive(one, VEHICLE, number / 10)
        if calibration.state.phase is CalibrationPhase.WAITING:
            calibration.confirm(number / 10)
        assert calibration.state.progress is None or 0.0 <= calibration.state.progress <= 1.0
    assert len([event for event in calibration.events() if event.is_over]) <= 1
