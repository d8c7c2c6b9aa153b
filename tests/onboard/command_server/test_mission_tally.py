"""What a mission takes is counted from its start to its end, for the comparison with its estimate."""

from msgspec import structs

from gloc3.messages.frames import GeoPoint, LocalFrame
from gloc3.messages.summaries import MissionSummary
from gloc3.mission.checking.estimate import Figures
from gloc3.mission.executing.items import Program
from gloc3.mission.model.states import Trigger
from gloc3.mission.reading.reader import Surroundings, read_mission
from gloc3.platform.platform import Capability
from gloc3_groundstation.missions.outline import Outline
from gloc3_groundstation.station.wording import taken
from gloc3_onboard.command_server.summaries import Tally

TEXT = "mission: m\nframe: hold\ntasks: {t: {actions: {a: {wait: {duration_s: 9}}}}}\n"


def program() -> Program:
    mission = read_mission(TEXT, "m", Surroundings(frames={"hold": LocalFrame(GeoPoint(39.5, 2.6, 5.0))}))
    return Program("mission", mission, {"wait": Capability(arguments="wait", performed_by="")})


def test_time_way_and_battery_are_counted_and_told_beside_the_estimate() -> None:
    mission = program()
    tally = Tally(mission)
    tally.look((0.0, 0.0, 0.0), 0.9, 1.0)
    mission.move(Trigger.START, 2.0)
    for second in range(3, 9):
        tally.look((second + 0.01 * (second % 2), 0.0, 0.0), 0.9 - 0.01 * second, float(second))
    assert tally.took_s == -1.0
    mission.move(Trigger.FINISH, 12.0)
    tally.look((8.0, 0.0, 0.0), 0.8, 12.0)
    assert (tally.took_s, tally.took_m) == (10.0, 5.0)
    assert abs(tally.took_battery - 0.07) < 1e-6
    told = MissionSummary(
        name="m", digest="", state="done", took_s=tally.took_s, took_m=tally.took_m, took_battery=tally.took_battery
    )
    least = Figures(duration_s=3.0, length_m=4.0, energy_wh=0.0, battery_share=0.02)
    outline = Outline(title="m", stages=(), duration_s=9.0, length_m=4.0, battery_share=0.06)
    assert taken(told, outline) == "took 10 s (about 9), 5 m (about 4), 7 % of the battery (about 6)"
    varying = taken(told, structs.replace(outline, least=least))
    assert varying == "took 10 s (about 3 to 9), 5 m (about 4), 7 % of the battery (about 2 to 6)"


def test_of_a_mission_that_was_under_way_before_only_the_time_is_known() -> None:
    mission = program()
    mission.move(Trigger.START, 2.0)
    mission.move(Trigger.FINISH, 12.0)
    tally = Tally(mission)
    tally.look((8.0, 0.0, 0.0), 0.8, 12.0)
    assert (tally.took_s, tally.took_m, tally.took_battery) == (10.0, -1.0, -1.0)
