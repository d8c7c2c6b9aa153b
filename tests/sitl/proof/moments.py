"""Made-up flights for invariants: a mission, a moment, a message."""

from typing import Any

from gloc3.messages.envelope import Envelope, Message, Source
from gloc3.mission.examples import find_mission
from gloc3.mission.reading.reader import MissionReferences, load_mission
from gloc3.platform.reader import load_platform
from gloc3_sitl.autopilot.modes import Behaviour
from gloc3_sitl.autopilot.verdict import Author
from gloc3_sitl.faults.faults import read_fault
from gloc3_sitl.proof.invariant import FlightFacts, FlownMission, TrueMoment

PLATFORM = load_platform("pelican_rtk")
MISSION = load_mission(str(find_mission("hop")), MissionReferences.of(PLATFORM))


def facts(
    *faults: str, platform: str = "pelican_rtk", floor_height_m: float = -1e9, is_calm: bool = True
) -> FlightFacts:
    """What is known of a flight of `hop`, with these faults."""
    known = PLATFORM if platform == "pelican_rtk" else load_platform(platform)
    return FlightFacts(known, MISSION, [read_fault(text) for text in faults], floor_height_m, is_calm)


def moment(t_s: float, **changed: Any) -> TrueMoment:
    """A moment of a flight two metres up, led by fresh setpoints."""
    return TrueMoment(
        t_s=t_s,
        position_ned_m=(0.0, 0.0, -2.0),
        velocity_ned_m_s=(0.0, 0.0, 0.0),
        height_above_ground_m=2.0,
        is_on_ground=False,
        is_armed=True,
        is_landed=False,
        behaviour=Behaviour.STREAMED,
        mode_name="Offboard",
        mode_author=Author.COMMAND,
        setpoint_age_s=0.02,
        has_transmitter=False,
    )._replace(**changed)


def message(
    payload: Message, t_s: float = 1.0, component: str = "somebody", boot: int = 1, sequence: int = 0
) -> Envelope[Any]:
    """A message on its way."""
    return Envelope(
        "pelican/topic", Source("pelican", component, boot), sequence, t_s, "", type(payload).__name__, payload
    )


def flown(**changed: Any) -> FlownMission:
    """The end of a flight that has landed."""
    last = moment(20.0, is_armed=False, is_landed=True, is_on_ground=True, position_ned_m=(0.0, 0.0, 0.0))
    return FlownMission(t_s=20.0, state="done", reason="", last=last, given_s=100.0)._replace(**changed)
