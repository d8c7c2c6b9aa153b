"""Who may command a vehicle: operators in control of it, and every operator where it has no companion."""

import asyncio

import pytest
from msgspec.structs import replace
from tests.groundstation.desk.test_autopilot_desk import HERON

from gloc3.clock import run_virtual
from gloc3.errors import Refused
from gloc3.exchange import LocalExchange
from gloc3.messages.command_interface import StationRole
from gloc3.messages.summaries import ControlState
from gloc3_groundstation.desk.control import require_control
from gloc3_groundstation.station.fleet import with_platform
from gloc3_groundstation.station.snapshots import Timed
from gloc3_groundstation.station.station import Station


@pytest.mark.parametrize(
    ("holder", "role", "has_companion", "reason"),
    [
        ("255", StationRole.OPERATOR, True, ""),
        ("254", StationRole.OPERATOR, True, "station 254 is in control of heron; request control"),
        ("", StationRole.OPERATOR, True, "nobody is in control of heron"),
        ("254", StationRole.OPERATOR, False, ""),
        ("255", StationRole.OBSERVER, True, "it is an observer"),
        ("255", StationRole.OBSERVER, False, "it is an observer"),
    ],
)
def test_a_vehicle_is_commanded_by_an_operator_in_control(
    holder: str, role: StationRole, *, has_companion: bool, reason: str
) -> None:
    async def main() -> None:
        station = Station(LocalExchange(), asyncio.get_running_loop(), "255", 11)
        station.client.role = role
        control = Timed(ControlState(holder=holder), 0.0)
        platform = replace(HERON, control=control, has_companion=has_companion)
        station.change(lambda fleet, now_s: with_platform(fleet, platform))
        try:
            require_control(station, "heron")
        finally:
            station.close()

    if reason:
        with pytest.raises(Refused, match=reason):
            run_virtual(main())
    else:
        run_virtual(main())
