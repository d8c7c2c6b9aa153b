"""The checker proves a mission against a platform and tells everything that is wrong at once."""

import re

import pytest
from msgspec import structs

from gloc3.errors import InputError
from gloc3.messages.frames import GeoPoint, Vector3
from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text, home_problem
from gloc3.mission.examples import example_missions, find_mission
from gloc3.mission.reading.reader import read_mission
from gloc3.platform.platform import Platform
from gloc3.platform.reader import load_platform, read_platform

MISSION = """\
mission: test
frame: hold
geofence: {polygon_m: [[-2, -2], [20, -2], [20, 12], [10, 12], [10, 6], [6, 6], [6, 12], [-2, 12]], ceiling_m: 8}
on_failure: land
tasks:
  depart:
    actions:
      climb:  {take_off: {height_m: 1.5}}
  sweep:
    after: [depart]
    deadline_s: 120
    actions:
      wall:   {follow_waypoints: {waypoints_m: [[2, 1, 2], [16, 1, 2]], speed_m_s: 0.5}}
      photos: {record_images: {camera: ground, every_m: 0.5}, until: wall}
  recover:
    after: [sweep]
    actions:
      home:   {return_home: {}}
      down:   {land: {}, after: [home]}
"""
HOME = (0.0, 0.0, 0.0)


def reported(report: CheckReport) -> list[str]:
    return [str(finding) for finding in report.findings]


@pytest.mark.parametrize("name", sorted(example_missions()))
def test_the_examples_pass_on_the_platform_that_they_are_written_for(name: str) -> None:
    text = find_mission(name).read_bytes()
    platform = load_platform(read_mission(text, name).platform or "boat")
    report = check_text(text, name, Circumstances(platform=platform, home_ned_m=HOME))
    assert reported(report) == []
    assert report.is_ok
    assert report.flyable().tasks


@pytest.mark.parametrize(
    ("header", "wanted"), [("pelican_rtk", ""), ("boat", "boat"), ("heron", "heron"), ("boat.yaml", "")]
)
def test_a_mission_that_is_written_for_another_platform_says_so(header: str, wanted: str, pelican: Platform) -> None:
    text = MISSION.replace("frame: hold", f"platform: {header}\nframe: hold")
    found = reported(check_text(text, "m", Circumstances(platform=pelican)))
    told = f"m:2:11: warning: it is written for {wanted}, and checked for pelican (change the line to platform: pelican"
    assert found == ([f"{told} if that is what you mean)"] if wanted else [])


def test_the_examples_take_the_time_that_is_promised(pelican: Platform) -> None:
    def duration_s(name: str) -> float:
        figures = check_text(
            find_mission(name).read_bytes(), name, Circumstances(platform=pelican, home_ned_m=HOME)
        ).estimate
        assert figures is not None
        return figures.duration_s

    assert duration_s("hop") < 30
    assert duration_s("inspection") < 100
    assert duration_s("patrol") > 560


def test_a_good_mission_has_figures_and_no_findings(pelican: Platform) -> None:
    report = check_text(MISSION, "m", Circumstances(platform=pelican, home_ned_m=HOME))
    assert reported(report) == []
    figures = report.estimate
    assert figures is not None
    assert figures.length_m == pytest.approx(1.5 + 5**0.5 + 0.05 + 14 + 16.03 + 2, abs=0.2)
    assert figures.actions["sweep.photos"].end_s == figures.actions["sweep.wall"].end_s
    assert figures.actions["recover.home"].start_s == figures.actions["sweep.wall"].end_s
    assert figures.duration_s == pytest.approx(3 + 1.5 + 4.6 + 0.2 + 28 + 0.2 + 6.5 + 7, abs=1.5)
    assert figures.energy_wh == pytest.approx(177 * figures.duration_s / 3600, rel=0.1)
    assert report.as_dict()["estimate"]["duration_s"] == round(figures.duration_s, 1)


@pytest.mark.parametrize(
    ("old", "new", "finding"),
    [
        ("[16, 1, 2]", "[21, 1, 2]", "m:13:60: waypoint 2 is 1.0 m outside the fence (move it inwards)"),
        ("[16, 1, 2]", "[19.7, 1, 2]",
         "m:13:60: waypoint 2 is 0.30 m inside the fence, less than the margin of 0.5 m (move it inwards)"),
        ("[[2, 1, 2], [16, 1, 2]]", "[[4, 8, 2], [12, 8, 2]]",
         "m:13:60: the straight path to waypoint 2 leaves the fence or its margin of 0.5 m (add a waypoint to go around)"),
        ("[2, 1, 2]", "[2, 1, 8.2]", "m:13:49: waypoint 1 is 0.2 m outside the fence (move it inwards)"),
        ("[2, 1, 2]", "[2, 1, 8.004]", "m:13:49: waypoint 1 is 0.004 m outside the fence (move it inwards)"),
        ("[2, 1, 2]", "[2, 1, 0.296]",
         "m:13:49: waypoint 1 is 0.296 m above home; the platform's limit is 0.3 m (raise it by 0.004 m, or lower limits.height_min_m in the platform file)"),
        ("[16, 1, 2]", "[19.501, 1, 2]",
         "m:13:60: waypoint 2 is 0.499 m inside the fence, less than the margin of 0.5 m (move it inwards)"),
        ("[2, 1, 2]", "[2, 1, 0.1]",
         "m:13:49: waypoint 1 is 0.1 m above home; the platform's limit is 0.3 m (raise it by 0.2 m, or lower limits.height_min_m in the platform file)"),
        ("height_m: 1.5", "height_m: 7.8",
         "m:8:37: climb's end is 0.20 m inside the fence, less than the margin of 0.5 m (move it inwards)"),
        ("speed_m_s: 0.5", "speed_m_s: 5",
         "m:13:84: 5 m/s exceeds the platform's limit of 3 m/s (fly slower)"),
        ("deadline_s: 120", "deadline_s: 20",
         "m:11:17: about 33 s are needed, but deadline_s is 20 (fly faster, shorten the mission, or raise deadline_s)"),
        (", until: wall", "",
         "m:14:7: sweep.photos never ends (set until, or a duration or count)"),
        ("camera: ground", "camera: front",
         "m:14:40: camera 'front' is not possible on pelican (known: ground)"),
        ("    after: [sweep]\n", "",
         "m:18:7: recover.down and depart.climb may run at the same time, and both claim motion (order them with after)"),
        (", after: [home]", "",
         "m:19:7: recover.down and recover.home may run at the same time, and both claim motion (order them with after)"),
        ("follow_waypoints", "folow_waypoints",
         "m:13:16: unknown capability 'folow_waypoints' (did you mean 'follow_waypoints'?)"),
        ("on_failure: land", "on_low_battery: continue",
         "m:4:17: on_low_battery is continue, but at 20 % the autopilot's failsafe is return"),
        ("on_failure: land", "on_pose_lost: return",
         "m:4:15: return_home needs the pose and cannot be flown without it (set on_pose_lost: land)"),
        ("down:   {land: {}, after: [home]}", "down:   {hold: {duration_s: 1}, after: [home]}",
         "m:5:1: warning: the mission ends in the air, and the vehicle stays there (end with land)"),
        ("climb:  {take_off: {height_m: 1.5}}", "climb:  {wait: {duration_s: 5}}",
         "m:5:1: warning: without take_off it can only be started in the air (begin with take_off)"),
        ("deadline_s: 120", "deadline_s: 1200", ""),
    ],
)  # fmt: skip
def test_each_mistake_is_found(old: str, new: str, finding: str, pelican: Platform) -> None:
    report = check_text(MISSION.replace(old, new, 1), "m", Circumstances(platform=pelican, home_ned_m=HOME))
    found = reported(report)
    assert any(line.startswith(finding) for line in found) if finding else not found
    assert report.is_ok is (not finding or "warning" in finding)


def test_the_margin_covers_the_wind_that_the_platform_file_states(pelican: Platform) -> None:
    near = MISSION.replace("[16, 1, 2]", "[19.4, 1, 2]", 1)
    text = {
        wind_m_s: reported(check_text(near, "m", Circumstances(platform=in_wind(pelican, wind_m_s), home_ned_m=HOME)))
        for wind_m_s in (0.0, 6.0)
    }
    assert text[0.0] == []
    assert text[6.0][0] == (
        "m:13:60: waypoint 2 is 0.60 m inside the fence, less than the margin of 0.86 m, 0.36 m of it for wind of 6 m/s "
        "(move it inwards)"
    )
    measured = structs.replace(pelican.limits, wind_m_s=6.0, wind_error_m=0.1)
    assert measured.margin_m == 0.6


def in_wind(platform: Platform, wind_m_s: float) -> Platform:
    return structs.replace(platform, limits=structs.replace(platform.limits, wind_m_s=wind_m_s))


def test_take_off_comes_first_and_once(pelican: Platform) -> None:
    circumstances = Circumstances(platform=pelican, home_ned_m=HOME)
    text = "mission: m\nframe: hold\ntasks:\n  t:\n    actions:\n      a: {go_to: {position_m: [1, 1, 2]}}\n"
    late = text + "      b: {take_off: {height_m: 2}, after: [a]}\n      c: {land: {}, after: [b]}\n"
    assert reported(check_text(late, "m", circumstances)) == [
        "m:6:11: t.a moves the vehicle on the ground (take off first)"
    ]
    twice = text.replace("go_to: {position_m: [1, 1, 2]}", "take_off: {height_m: 2}")
    twice += "      b: {take_off: {height_m: 2}, after: [a]}\n      c: {land: {}, after: [b]}\n"
    assert reported(check_text(twice, "m", circumstances)) == ["m:7:11: t.b takes off while in the air (land first)"]


def test_a_home_near_or_outside_the_fence_is_refused(pelican: Platform) -> None:
    report = check_text(MISSION, "m", Circumstances(platform=pelican, home_ned_m=(-1.7, 0.0, 0.0)))
    assert (
        "m:3:1: home is 0.30 m inside the fence; at least 0.5 m are needed (move the vehicle or the fence)"
        in reported(report)
    )
    assert report.mission is not None
    assert home_problem(report.mission, (-5.0, 0.0, 0.0)) == "home is 3.0 m outside the fence"
    assert home_problem(report.mission, HOME) == ""


ON_EARTH = """\
mission: on Earth
frame: geo
geofence: {polygon: [[46.9995, 7.9995], [47.0005, 7.9995], [47.0005, 8.0005], [46.9995, 8.0005]], ceiling_m: 20}
on_failure: land
tasks:
  depart: {actions: {climb: {take_off: {height_m: 2}}, look: {hold: {duration_s: 5}, after: [climb]}}}
  sweep: {after: [depart], actions: {out: {follow_waypoints: {waypoints: [[47.0, 8.0, 2], [47.0, 8.0001, 2]]}}}}
  recover: {after: [sweep], actions: {home: {return_home: {}}, down: {land: {}, after: [home]}}}
"""
ORIGIN = GeoPoint(47.0, 8.0, 400.0)


@pytest.mark.parametrize("name", ["pelican_rtk", "copter", None])
def test_without_a_home_nothing_is_judged_against_an_invented_one(name: str | None) -> None:
    report = check_text(ON_EARTH, "m", Circumstances(platform=load_platform(name) if name else None))
    assert reported(report) == []
    assert report.estimate is not None
    assert report.estimate.length_m < 30.0  # from the first waypoint, not from a corner of the fence 70 m away


def test_a_contingency_without_a_home_is_not_judged_there_either() -> None:
    text = ON_EARTH + "on_link_loss: {task: down, then: hold}\ncontingencies: {down: {actions: {d: {land: {}}}}}\n"
    report = check_text(text, "m", Circumstances(platform=load_platform("pelican_rtk")))
    assert reported(report) == []


def test_a_plane_without_a_home_is_not_told_where_it_circles_after_its_return() -> None:
    text = (
        ON_EARTH.replace("46.9995", "46.99").replace("47.0005", "47.01").replace("7.9995", "7.99")
        .replace("8.0005", "8.01").replace("ceiling_m: 20", "ceiling_m: 110").replace("height_m: 2}", "height_m: 50}")
        .replace("8.0, 2]", "8.0, 50]").replace("8.0001, 2]", "8.0060, 50]").replace("5}, after", "30}, after")
    )  # fmt: skip
    report = check_text(text, "m", Circumstances(platform=load_platform("plane")))
    assert [line for line in reported(report) if "fence" in line] == []


@pytest.mark.parametrize(
    ("home_ned_m", "expected"),
    [
        ((0.0, 0.0, 0.0), []),
        ((55.3, 0.0, 0.0), ["home is 0.29 m inside the fence", "climb's end is 0.29 m", "look's end", "home's end", "down's end"]),
        ((60.0, 0.0, 0.0), ["home is 4.4 m outside the fence", "climb's end is 4.4 m", "look's end", "home's end", "down's end"]),
    ],
)  # fmt: skip
def test_a_home_that_is_known_is_judged_for_real(home_ned_m: Vector3, expected: list[str]) -> None:
    circumstances = Circumstances(
        platform=load_platform("pelican_rtk"), origin=ORIGIN, home_altitude_m=400.0, home_ned_m=home_ned_m
    )
    found = reported(check_text(ON_EARTH, "m", circumstances))
    assert [one for one in expected if not any(one in line for line in found)] == []
    assert len(found) == len(expected)


@pytest.mark.parametrize("waypoint", ["[[47.001, 8.0, 2], [47.0, 8.0001, 2]]", "[[47.001, 8.0, 2]]"])
def test_a_first_waypoint_outside_the_fence_is_found_where_home_is_not_known(waypoint: str) -> None:
    text = ON_EARTH.replace("[[47.0, 8.0, 2], [47.0, 8.0001, 2]]", waypoint)
    found = reported(check_text(text, "m", Circumstances()))
    assert len(found) == 1
    assert "waypoint 1 is 55.6 m outside the fence" in found[0]


def test_a_mission_beyond_the_battery_is_refused_with_figures(pelican: Platform) -> None:
    text = MISSION.replace("deadline_s: 120", "deadline_s: 9000").replace(
        "speed_m_s: 0.5", "speed_m_s: 0.5, hold_s: 600"
    )
    found = reported(check_text(text, "m", Circumstances(platform=pelican, home_ned_m=HOME)))
    assert found == [
        "m:1:10: about 61.6 Wh are needed, but only 53.2 Wh of 71 Wh may be used (reserve 25 %) (shorten the mission, or split it into several)"
    ]


def test_returning_must_be_possible_on_the_reserve(platform_text: str) -> None:
    small = read_platform(
        platform_text.replace("reserve: 0.25", "reserve: 0.01")
        .replace("at: 0.2", "at: 0.005")
        .replace("hover_w: 165", "hover_w: 400"),
        "p",
    )
    found = reported(check_text(MISSION, "m", Circumstances(platform=small, home_ned_m=HOME)))
    assert len(found) == 1
    assert re.search(r"the return from the farthest place, waypoint \d, takes \d", found[0])


@pytest.mark.parametrize(
    ("failsafe", "policy", "expected"),
    [
        ("action: continue", "continue", ""),
        (
            "action: return, after_s: 10",
            "continue",
            "on_link_loss is continue, but after 10 s the autopilot's failsafe is return",
        ),
        ("action: return, after_s: 10", "hold", "on_link_loss is hold, but after 10 s"),
        ("action: return, after_s: 10", "land", ""),
        (
            "action: return, after_s: 3",
            "land",
            "the autopilot's return after 3 s of link loss precedes land at 5 s",
        ),
        ("action: return, after_s: 3", "return", ""),
        ("action: land, after_s: 9", "abort", ""),
    ],
)
def test_link_loss_policies_agree_with_the_autopilot_s_failsafe(
    platform_text: str, failsafe: str, policy: str, expected: str
) -> None:
    platform = read_platform(platform_text.replace("failsafes: {", f"failsafes: {{link_loss: {{{failsafe}}}, "), "p")
    text = MISSION.replace("on_failure: land", f"on_failure: land\non_link_loss: {policy}")
    found = reported(check_text(text, "m", Circumstances(platform=platform, home_ned_m=HOME)))
    assert found == [] if not expected else (len(found) == 1 and expected in found[0])


@pytest.mark.parametrize(
    ("failsafe", "policy", "expected"),
    [
        ("action: land, at: 0.1", "return", ""),
        ("action: land, at: 0.25", "return", "on_low_battery is return, but at 25 % the autopilot's failsafe is land"),
        ("action: land, at: 0.1", "hold", "on_low_battery is hold, but at 10 % the autopilot's failsafe is land"),
        ("action: hold, at: 0.1", "return", ""),
        ("action: hold, at: 0.25", "return", "the autopilot's hold at 25 % battery precedes return at the reserve of"),
    ],
)
def test_what_returns_at_the_reserve_may_be_landed_by_the_autopilot_in_the_end(
    platform_text: str, failsafe: str, policy: str, expected: str
) -> None:
    text = re.sub(r"low_battery: {.*?}", f"low_battery: {{{failsafe}}}", platform_text, count=1)
    mission = MISSION.replace("on_failure: land", f"on_failure: land\non_low_battery: {policy}")
    found = reported(check_text(mission, "m", Circumstances(platform=read_platform(text, "p"), home_ned_m=HOME)))
    assert found == [] if not expected else (len(found) == 1 and expected in found[0])


def test_what_a_capability_needs_must_be_there(platform_text: str) -> None:
    text = platform_text.replace(
        "performed_by: waypoints, claims: [motion], needs: [pose",
        "performed_by: waypoints, claims: [motion], needs: [odometry",
    )
    found = reported(check_text(MISSION, "m", Circumstances(platform=read_platform(text, "p"), home_ned_m=HOME)))
    assert found[0] == (
        "m:13:16: warning: follow_waypoints needs 'odometry', which nothing on pelican provides "
        "(not all components' classes are installed here)"
    )


def test_without_a_platform_the_file_alone_is_checked() -> None:
    report = check_text(MISSION.replace("    after: [sweep]\n", "", 1), "m", Circumstances())
    assert reported(report)[0].startswith("m:2:8: warning: frame 'hold' is not known here")
    assert any("both claim motion" in line for line in reported(report))
    assert check_text(MISSION, "m", Circumstances()).is_ok


def test_errors_of_all_kinds_are_told_together(pelican: Platform) -> None:
    text = (
        MISSION.replace("[16, 1, 2]", "[21, 1, 2]")
        .replace("camera: ground", "camra: ground")
        .replace("speed_m_s: 0.5", "speed_m_s: 5")
    )
    found = reported(check_text(text, "m", Circumstances(platform=pelican, home_ned_m=HOME)))
    assert [line.partition(": ")[2][:30] for line in found] == [
        "waypoint 2 is 1.0 m outside th",
        "5 m/s exceeds the platform's l",
        "'camera' is missing in record_",
        "unknown key 'camra' (did you m",
    ]


def test_a_file_that_is_no_mission_is_told_without_a_traceback(pelican: Platform) -> None:
    assert reported(check_text("[1, 2]", "m", Circumstances(platform=pelican))) == [
        "m:1:1: a mission file is a mapping (begin with 'mission: NAME')"
    ]
    with pytest.raises(InputError, match="no_such_mission: no such mission"):
        find_mission("no_such_mission")


def test_an_action_that_cannot_be_read_does_not_hide_what_comes_after_it(pelican: Platform) -> None:
    text = """
mission: m
frame: hold
tasks:
  t:
    actions:
      up: {take_of: {height_m: 1.5}}
      down: {land: {}, after: [up]}
"""
    report = check_text(text, "m.yaml", Circumstances(platform=pelican))
    assert not report.is_ok
    assert any("take_off" in str(finding) and finding.line == 7 for finding in report.findings)


@pytest.mark.parametrize(("speed_m_s", "end_m", "is_told"), [(5.0, 16, True), (3.0, 16, False), (5.0, 2, False)])
def test_a_fast_path_near_the_fence_is_told_with_what_a_late_pose_would_cost(
    speed_m_s: float, end_m: float, is_told: bool, pelican: Platform
) -> None:
    fast = structs.replace(pelican, limits=structs.replace(pelican.limits, speed_m_s=6.0, acceleration_m_s2=3.0))
    wide = "geofence: {polygon_m: [[-30, -30], [18, -30], [18, 30], [-30, 30]]}"
    text = MISSION.replace(MISSION.splitlines()[2], wide).replace("speed_m_s: 0.5", f"speed_m_s: {speed_m_s}")
    text = text.replace("[[2, 1, 2], [16, 1, 2]]", f"[[2, 1, 2], [{end_m}, 1, 2]]")
    report = check_text(text, "m", Circumstances(platform=fast, home_ned_m=HOME))
    assert report.is_ok
    told = "at 5 m/s it flies 0.8 m before it brakes for a late pose, more than the margin of 0.5 m, and comes within 2.0 m"
    assert any(told in one for one in reported(report)) is is_told
