"""What a mission takes is counted from its start to its end, for the comparison with its estimate."""

from msgspec import structs

from gloc3.messages.frames import GeoPoint, LocalFrame
from gloc3.messages.summaries import MissionSummary
from gloc3.mission.checking.estimate import MissionFigures
from gloc3.mission.executing.items import MissionProgram
from gloc3.mission.model.states import StateTrigger
from gloc3.mission.reading.reader import MissionReferences, read_mission
from gloc3.platform.platform import Capability
from gloc3_groundstation.missions.outline import Outline
from gloc3_groundstation.station.wording import used
from gloc3_onboard.command_server.summaries import RequestCounts

TEXT = "mission: m\nframe: hold\ntasks: {t: {actions: {a: {wait: {duration_s: 9}}}}}\n"


def program() -> MissionProgram:
    mission = read_mission(TEXT, "m", MissionReferences(frames={"hold": LocalFrame(GeoPoint(39.5, 2.6, 5.0))}))
    return MissionProgram("mission", mission, {"wait": Capability(arguments="wait", performed_by="")})


def test_time_way_and_battery_are_counted_and_told_beside_the_estimate() -> None:
    mission = program()
    counts = RequestCounts(mission)
    counts.update((0.0, 0.0, 0.0), 0.9, 1.0)
    mission.move(StateTrigger.START, 2.0)
    for second in range(3, 9):
        counts.update((second + 0.01 * (second % 2), 0.0, 0.0), 0.9 - 0.01 * second, float(second))
    assert counts.took_s == -1.0
    mission.move(StateTrigger.FINISH, 12.0)
    counts.update((8.0, 0.0, 0.0), 0.8, 12.0)
    assert (counts.took_s, counts.took_m) == (10.0, 5.0)
    assert abs(counts.took_battery - 0.07) < 1e-6
    reported = MissionSummary(
        name="m", digest="", state="done", took_s=counts.took_s, took_m=counts.took_m, took_battery=counts.took_battery
    )
    least = MissionFigures(duration_s=3.0, length_m=4.0, energy_wh=0.0, battery_share=0.02)
    outline = Outline(title="m", stages=(), duration_s=9.0, length_m=4.0, battery_share=0.06)
    assert used(reported, outline) == "took 10 s (about 9), 5 m (about 4), 7 % of the battery (about 6)"
    varying = used(reported, structs.replace(outline, least=least))
    assert varying == "took 10 s (about 3 to 9), 5 m (about 4), 7 % of the battery (about 2 to 6)"


def test_of_a_mission_that_was_under_way_before_only_the_time_is_known() -> None:
    mission = program()
    mission.move(StateTrigger.START, 2.0)
    mission.move(StateTrigger.FINISH, 12.0)
    counts = RequestCounts(mission)
    counts.update((8.0, 0.0, 0.0), 0.8, 12.0)
    assert (counts.took_s, counts.took_m, counts.took_battery) == (10.0, -1.0, -1.0)
