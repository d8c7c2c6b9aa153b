"""What an autopilot says against a start, in words; leave to arm; and its clock."""

from typing import Any

import pytest

from gloc3.clock import VirtualLoop
from gloc3.exchange import LocalExchange, Publisher
from gloc3.mavlink.codec import message
from gloc3.mavlink.services.command import CommandResult
from gloc3.messages.summaries import Health, Summary
from gloc3_onboard.autopilot.arm_authority import ArmAuthority
from gloc3_onboard.autopilot.health_words import estimator_problems
from gloc3_onboard.autopilot.telemetry import REPEATED_S

from .test_autopilot_link import STYLES, Rig

pytestmark = pytest.mark.thorough

PREARM, AUTHORISATION = 401, 3001
GOOD = 0x3F


@pytest.mark.parametrize(
    ("name", "fields", "doubts"),
    [
        ("EKF_STATUS_REPORT", {"flags": GOOD}, []),
        ("EKF_STATUS_REPORT", {"flags": 0x01 | 0x20 | 0x300}, []),
        ("EKF_STATUS_REPORT", {"flags": 0x400}, ["the estimator has not started"]),
        (
            "EKF_STATUS_REPORT",
            {"flags": 0x01 | 0x20 | 0x80},
            ["the estimator has no horizontal position: it assumes that the vehicle stands still"],
        ),
        ("EKF_STATUS_REPORT", {"flags": GOOD & ~0x20}, ["the estimator has no height"]),
        ("EKF_STATUS_REPORT", {"flags": GOOD | 0x8000}, ["GPS glitches"]),
        (
            "EKF_STATUS_REPORT",
            {"flags": GOOD, "compass_variance": 1.3},
            ["the estimator rejects the compass (test ratio 1.3, limit 1)"],
        ),
        ("ESTIMATOR_STATUS", {"flags": GOOD}, []),
        ("ESTIMATOR_STATUS", {"flags": GOOD & ~0x01}, ["the estimator has no attitude"]),
        ("ESTIMATOR_STATUS", {"flags": GOOD | 0x400}, ["GPS glitches"]),
        ("ESTIMATOR_STATUS", {"flags": GOOD | 0x800}, ["the estimator reports an accelerometer error"]),
        (
            "ESTIMATOR_STATUS",
            {"flags": GOOD, "pos_horiz_ratio": 2.0},
            ["the estimator rejects the horizontal position (test ratio 2.0, limit 1)"],
        ),
    ],
)
def test_the_flags_of_an_estimator_in_words(name: str, fields: dict[str, Any], doubts: list[str]) -> None:
    assert estimator_problems(message(name, **fields)) == doubts


@STYLES
def test_what_the_estimator_says_reaches_the_state(style: str) -> None:
    with Rig(style) as rig:
        rig.run(4.0)
        assert rig.device.state().doubts == []
        rig.autopilot.estimator_flags = 0x01 | 0x20
        rig.run(2.0)
        assert rig.device.state().doubts == ["the estimator has no horizontal position"]


def not_ready(rig: Rig) -> None:
    rig.run(3.0)
    rig.autopilot.prearm_health = 0


@STYLES
def test_an_autopilot_that_would_not_arm_is_asked_why_now_and_then(style: str) -> None:
    with Rig(style) as rig:
        not_ready(rig)
        rig.autopilot.refuses[PREARM] = CommandResult.ACCEPTED, "PreArm: Compass not calibrated"
        rig.run(5.0)
        assert rig.device.state().reasons == ["PreArm: Compass not calibrated"]
        rig.run(35.0)
        assert 2 <= len(rig.requested(PREARM)) <= 4
        rig.autopilot.prearm_health = 1 << 28
        rig.run(2.0)
        requested = len(rig.requested(PREARM))
        rig.run(40.0)
        assert len(rig.requested(PREARM)) == requested, "it would arm"


def test_who_does_not_know_the_question_is_not_asked_again() -> None:
    with Rig("ardupilot") as rig:
        not_ready(rig)
        rig.autopilot.refuses[PREARM] = CommandResult.UNSUPPORTED, ""
        rig.run(60.0)
        assert len(rig.requested(PREARM)) == 1


def test_a_reason_that_is_not_repeated_is_over() -> None:
    with Rig("ardupilot") as rig:
        not_ready(rig)
        rig.autopilot.report("PreArm: Compass not calibrated")
        rig.run(0.5 * REPEATED_S)
        rig.autopilot.report("PreArm: Battery 1 low voltage failsafe")
        rig.run(0.1)
        assert len(rig.device.state().reasons) == 2
        rig.run(0.6 * REPEATED_S)
        assert rig.device.state().reasons == ["PreArm: Battery 1 low voltage failsafe"]


def test_a_configuration_error_of_ardupilot_is_a_reason_until_it_is_repaired() -> None:
    """Its loop is not started then, and it repeats this every 5 s."""
    with Rig("ardupilot") as rig:
        not_ready(rig)
        rig.autopilot.report("Config Error: RC7_OPTION: unsupported")
        rig.autopilot.report("Config Error: fix problem then reboot")
        rig.run(0.1)
        assert rig.device.state().reasons == [
            "Config Error: RC7_OPTION: unsupported",
            "Config Error: fix problem then reboot",
        ]


@pytest.mark.parametrize("why_not", ["", "a required component is faulty"])
def test_leave_to_arm_is_given_or_refused_with_its_reason(why_not: str) -> None:
    with Rig() as rig:
        rig.why_not_arm = why_not
        rig.run(4.0)
        rig.autopilot.received.clear()
        for target in (191, 0):
            rig.autopilot.send(
                "COMMAND_LONG", command=AUTHORISATION, target_system=1, target_component=target, confirmation=target % 2
            )
            rig.run(0.5)
        acks = [m for m in rig.autopilot.received if m.name == "COMMAND_ACK" and m.command == AUTHORISATION]
        texts = [m.text for m in rig.autopilot.received if m.name == "STATUSTEXT"]
        assert acks
        if why_not:
            assert acks[0].result == CommandResult.DENIED
            assert texts[0].startswith("Arming not authorised: a required")
        else:
            assert (acks[0].result, acks[0].result_param2) == (CommandResult.ACCEPTED, 10)
            assert texts == []


def test_nobody_else_may_ask_for_leave_and_other_commands_are_not_answered_here() -> None:
    with Rig() as rig:
        rig.run(4.0)
        rig.autopilot.received.clear()
        rig.autopilot.send("COMMAND_LONG", command=512, target_system=1, target_component=191)
        from gloc3.mavlink.codec import Encoder

        stranger = Encoder(9, 1).encode(
            message("COMMAND_LONG", command=AUTHORISATION, target_system=1, target_component=191)
        )
        rig.routed.receive(stranger)
        rig.run(0.5)
        assert not [m for m in rig.autopilot.received if m.name == "COMMAND_ACK"]


def test_leave_follows_the_summaries_of_the_command_interface() -> None:
    exchange, loop = LocalExchange(), VirtualLoop()
    authority = ArmAuthority(exchange, "pelican")
    publisher = Publisher(exchange, "pelican", "command_server", 1)
    assert "is down" in authority.why_not(0.0)
    publisher.publish("pelican/ci/summary", Summary(table=1, health=Health.WORKING, lines=[]), 10.0)
    assert authority.why_not(11.0) == ""
    assert "is down" in authority.why_not(14.0)
    publisher.publish("pelican/ci/summary", Summary(table=1, health=Health.FAULTY, lines=[]), 14.0)
    assert authority.why_not(14.5) == "a required component is faulty"
    authority.close()
    loop.close()


def test_the_autopilot_is_told_its_own_time_and_asked_for_it() -> None:
    with Rig() as rig:
        rig.run(10.0)
        rig.autopilot.boot()
        rig.run(6.0)
        rig.autopilot.received.clear()
        rig.autopilot.send("TIMESYNC", tc1=0, ts1=77)
        rig.run(0.2)
        answer = next(m for m in rig.autopilot.received if m.name == "TIMESYNC" and m.ts1 == 77)
        booted_s = rig.autopilot.boot_s - 0.2
        assert answer.tc1 * 1e-9 == pytest.approx(booted_s, abs=0.06), "poses are stamped in the same time"
        assert [m for m in rig.autopilot.received if m.name == "TIMESYNC" and m.tc1 == 0]


@STYLES
def test_a_restart_that_shows_in_the_clock_alone_is_noticed_and_the_streams_are_asked_for_again(style: str) -> None:
    with Rig(style) as rig:
        rig.run(20.0)
        rig.autopilot.boot()
        for name in ("LOCAL_POSITION_NED", "ATTITUDE_QUATERNION", "SYS_STATUS", "DISTANCE_SENSOR"):
            rig.autopilot.set_rate(name, 0.0)
        rig.reported.clear()
        elapsed_s = rig.until(lambda: "the autopilot has restarted" in rig.reported, 4.0)
        assert elapsed_s < 3.0
        rig.until(lambda: rig.autopilot.rate_hz("LOCAL_POSITION_NED") == pytest.approx(20.0), 3.0)
        assert rig.reported.count("the autopilot has restarted") == 1


@STYLES
@pytest.mark.parametrize("stalled_s", [0.25, 2.0])
def test_an_autopilot_whose_clock_stood_still_has_not_restarted_and_its_poses_are_not_old(
    style: str, stalled_s: float
) -> None:
    with Rig(style) as rig:
        rig.run(20.0)
        rig.autopilot.is_off = True
        rig.run(stalled_s)
        rig.autopilot.is_off = False
        rig.autopilot.stall(stalled_s)
        rig.run(12.0)
        pose = rig.device.pose()
        assert pose is not None
        assert rig.loop.time() - pose.t_s < 0.12
        assert "the autopilot has restarted" not in rig.reported
