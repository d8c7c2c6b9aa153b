"""An autopilot that asks before it arms, and the platform's own command interface that gives leave: both in one loop."""

from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.mavlink.codec import MavlinkMessage, message
from gloc3.messages.summaries import Health

ASKS = {"COM_ARM_AUTH_REQ": 1.0, "COM_ARM_AUTH_ID": 1.0}
REQUEST, ARM = 3001, 400
ACCEPTED, DENIED, REASON_IS_REPORTED = 0, 2, 1


def answers(flight: Card) -> list[MavlinkMessage]:
    """What the companion has answered to the autopilot that asked."""
    sent = (sent for _, sent in flight.to_autopilot)
    return [sent for sent in sent if sent.name == "COMMAND_ACK" and sent.command == REQUEST]


@ONE_STYLE
def test_a_platform_that_is_well_is_armed_with_its_own_leave_and_flies(flight: Card) -> None:
    flight.begin(mission(), parameters=ASKS)
    flight.await_state("mission", "done", 60.0)
    (answer,) = answers(flight)
    assert (answer.result, answer.result_param2) == (ACCEPTED, 10)


@ONE_STYLE
def test_a_platform_with_a_faulty_part_is_armed_by_nobody_and_the_reason_is_said(flight: Card) -> None:
    flight.begin(mission(), is_started=False, parameters=ASKS)
    flight.fault("crash:take_off", for_s=60.0)
    flight.until(lambda: flight.health is Health.FAULTY, 10.0, "the platform is not well")
    for _ in range(2):
        flight.flight.process.vehicle.autopilot.send_message(
            message("COMMAND_LONG", target_system=1, target_component=1, command=ARM, param1=1.0)
        )
        flight.wait(2.0)
    assert [(answer.result, answer.progress) for answer in answers(flight)] == 2 * [(DENIED, REASON_IS_REPORTED)]
    assert not flight.autopilot.is_armed
    texts = [sent.text for _, sent in flight.to_autopilot if sent.name == "STATUSTEXT"]
    assert any(text.startswith("Arming not authorised: a required component") for text in texts)
