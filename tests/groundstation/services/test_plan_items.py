"""Plans between files and the wire: home, jumps, fences and rally points of either firmware, and what differs."""

from dataclasses import dataclass

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.data_folders import MISSIONS

from gloc3.errors import Refused
from gloc3.mavlink.services.plan import PlanItem, PlanType
from gloc3.mission.formats import load_plan, read_plan, read_wpl, write_plan
from gloc3.mission.formats.commands import JUMP as DO_JUMP
from gloc3.mission.formats.items import FenceArea, ForeignPlan, MavItem, PlanEntry
from gloc3_groundstation.services.plan_items import PlanParts, differences, from_wire, to_wire
from gloc3_groundstation.services.snapshot import Firmware

WPL = (
    "QGC WPL 110\n"
    "0\t1\t0\t16\t0\t0\t0\t0\t47.1\t8.1\t500\t1\n"
    "1\t0\t3\t22\t0\t0\t0\t0\t0\t0\t10\t1\n"
    "2\t0\t3\t16\t0\t0\t0\t0\t47.2\t8.2\t20\t1\n"
    "3\t0\t2\t177\t2\t5\t0\t0\t0\t0\t0\t1\n"
)


def plan_of(*items: MavItem, **fields: object) -> ForeignPlan:
    return ForeignPlan(entries=tuple(PlanEntry(items=(item,)) for item in items), raw={}, **fields)  # type: ignore[arg-type]


def test_a_file_of_waypoints_goes_to_either_firmware_with_its_home_and_jumps() -> None:
    plan = read_wpl(WPL, "a.waypoints")
    ardupilot, px4 = (to_wire(plan, firmware).mission for firmware in (Firmware.ARDUPILOT, Firmware.PX4))
    assert [item.command for item in ardupilot] == [16, 22, 16, DO_JUMP]
    assert (ardupilot[0].x, ardupilot[0].frame, ardupilot[3].param1) == (471_000_000, 0, 2.0)
    assert [item.command for item in px4] == [22, 16, DO_JUMP]
    assert px4[2].param1 == 1.0
    assert [item.is_current for item in px4] == [True, False, False]


def test_what_names_no_place_goes_to_px4_in_the_frame_for_that() -> None:
    rows = (
        MavItem(command=22, frame=3, z=10.0),
        MavItem(command=195, frame=3, x=47.1, y=8.5),
        MavItem(command=189, frame=0),
        MavItem(command=178, frame=3, params=(0.0, 2.0, 0.0, 0.0)),
        MavItem(command=20, frame=3),
    )
    frames = {f: [item.frame for item in to_wire(plan_of(*rows), f).mission] for f in Firmware}
    assert frames[Firmware.PX4] == [3, 3, 2, 2, 2]
    assert frames[Firmware.ARDUPILOT] == [0, 3, 3, 0, 3, 3]


@pytest.mark.parametrize("firmware", list(Firmware))
def test_a_plan_comes_back_from_the_wire_as_it_went(firmware: Firmware) -> None:
    plan = plan_of(
        MavItem(command=22, frame=3, params=(0.0, 0.0, 0.0, None), x=47.1, y=8.5, z=10.0),
        MavItem(command=DO_JUMP, frame=2, params=(1.0, 3.0, 0.0, 0.0)),
        home=(47.0, 8.0, 400.0),
        fence=(
            FenceArea(is_inclusion=False, center=(1.5, 2.5), radius_m=20.0),
            FenceArea(is_inclusion=True, polygon=((1.0, 2.0), (1.0, 3.0), (2.0, 3.0))),
            FenceArea(is_inclusion=False, polygon=((1.0, 2.0), (1.0, 3.0), (2.0, 3.0), (2.0, 2.0))),
        ),
        rally=((1.0, 2.0, 30.0),),
    )
    back = from_wire(to_wire(plan, firmware), firmware)
    assert (back.fence, back.rally) == (plan.fence, plan.rally)
    assert [(i.command, i.params, i.z) for i in back.items] == [(i.command, i.params, i.z) for i in plan.items]
    assert back.home == (plan.home if firmware is Firmware.ARDUPILOT else None)
    again = read_plan(write_plan(back), "b.plan")
    assert (again.fence, again.rally, len(again.items)) == (plan.fence, plan.rally, 2)


@pytest.mark.parametrize(
    ("items", "words"),
    [
        (
            [PlanItem(command=5001, param1=4.0)] * 3,
            "fence item 0 .NAV_FENCE_POLYGON_VERTEX_INCLUSION. is not understood",
        ),
        ([PlanItem(command=5001, param1=3.0)] * 2 + [PlanItem(command=5002, param1=3.0)], "an incomplete polygon"),
        ([PlanItem(command=5001, param1=0.0)], "not understood"),
        ([PlanItem(command=16)], "fence item 0 .NAV_WAYPOINT. is not understood"),
    ],
)
def test_a_fence_that_is_not_understood_is_refused(items: list[PlanItem], words: str) -> None:
    with pytest.raises(Refused, match=words):
        from_wire(PlanParts(fence=tuple(items)), Firmware.PX4)


def test_what_does_not_fit_the_wire_is_refused() -> None:
    with pytest.raises(Refused, match="item 0: 300 does not fit the wire"):
        to_wire(plan_of(MavItem(command=16, frame=3, x=300.0)), Firmware.PX4)
    with pytest.raises(Refused, match="item 0: 1e\\+39 does not fit the wire"):
        to_wire(plan_of(MavItem(command=16, frame=3, z=1e39)), Firmware.PX4)


@dataclass(frozen=True)
class Case:
    changes: dict[str, object]
    text: str


@pytest.mark.parametrize(
    "case",
    [
        Case({"command": 21}, "command 16 is wanted, 21 is there"),
        Case({"frame": 0}, "frame 3 is wanted, 0 is there"),
        Case({"param1": 2.0}, "param1 1 is wanted, 2 is there"),
        Case({"x": 471_000_005}, "x 471000000 is wanted, 471000005 is there"),
        Case({"z": 10.5}, "height 10 m is wanted, 10.5 m is there"),
    ],
)
def test_what_matters_is_a_difference(case: Case) -> None:
    item = PlanItem(command=16, frame=3, param1=1.0, param4=float("nan"), x=471_000_000, y=85_000_000, z=10.0)
    other = msgspec.structs.replace(item, **case.changes)
    (found,) = differences([item, item], [item, other], PlanType.MISSION, Firmware.PX4)
    assert str(found) == f"mission item 1: {case.text}"


def test_what_a_vehicle_keeps_in_its_own_way_is_none() -> None:
    wanted = PlanItem(command=16, frame=6, param1=0.1, param4=float("nan"), x=471_000_000, z=10.004)
    found = PlanItem(command=16, frame=3, param1=0.10000000149, param4=0.0, x=471_000_001, z=10.0, is_current=True)
    assert differences([wanted], [found], PlanType.MISSION, Firmware.PX4) == ()
    home = PlanItem(command=16, x=1)
    assert differences([home, wanted], [PlanItem(command=16, x=9), found], PlanType.MISSION, Firmware.ARDUPILOT) == ()


def test_a_missing_item_is_a_difference() -> None:
    (found,) = differences([PlanItem(command=16)], [], PlanType.RALLY, Firmware.PX4)
    assert str(found) == "rally item 0: 1 item wanted, 0 there"


values = st.floats(-180.0, 180.0, width=32)
items = st.builds(
    lambda command, frame, x, y, z, param: MavItem(
        command=command, frame=frame, params=(param, 0.0, 0.0, None), x=x, y=y, z=z
    ),
    st.sampled_from([16, 21, 22, 82, 93, 178]),
    st.sampled_from([0, 3, 10, 2, 1]),
    values,
    values,
    values,
    values,
)


@settings(max_examples=60)
@given(st.lists(items, min_size=1, max_size=6), st.sampled_from(Firmware))
def test_every_plan_is_the_same_after_a_round_trip(rows: list[MavItem], firmware: Firmware) -> None:
    plan = plan_of(*rows, home=(1.0, 2.0, 3.0))
    parts = to_wire(plan, firmware)
    again = to_wire(from_wire(parts, firmware), firmware)
    assert differences(parts.mission, again.mission, PlanType.MISSION, firmware) == ()


@pytest.mark.outside
@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("px4/multicopter_mission_geofence_avoid.plan", (5, 9, 0)),
        ("mavsdk/qgroundcontrol_sample_with_survey.plan", (13, 0, 0)),
        ("px4/MC_mission_box.plan", (6, 0, 0)),
    ],
)
def test_real_plans_go_on_the_wire(name: str, counts: tuple[int, int, int]) -> None:
    parts = to_wire(load_plan(MISSIONS / name), Firmware.PX4)
    assert (len(parts.mission), len(parts.fence), len(parts.rally)) == counts
