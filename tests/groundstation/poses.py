"""Every screen and dialogue of the terminal with something in it, in turn: what pictures and programs look at."""

from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing
from pathlib import Path
from tempfile import TemporaryDirectory

from textual.containers import VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Input, OptionList, TextArea

from gloc3.messages.command_interface import CommandComponent, RequestAction
from gloc3.messages.envelope import Severity
from gloc3.messages.preflight import Check, Group, Verdict
from gloc3.messages.summaries import ControlState
from gloc3.messages.vehicle import ObstacleScan
from gloc3_groundstation.store.configuration import Configuration, ThemeName
from gloc3_groundstation.tui.dialogues.component_dialogues import ComponentMenu, FunctionForm
from gloc3_groundstation.tui.dialogues.mission_files import OpenMission, SaveMission, UnsavedQuestion
from gloc3_groundstation.tui.dialogues.questions import EmergencyQuestion, TextQuestion, YesNoQuestion
from gloc3_groundstation.tui.dialogues.single_action import SingleAction
from gloc3_groundstation.tui.help import HelpScreen
from gloc3_groundstation.tui.widgets.panel import ListPanel, Panel

from .drawn import READABLE, clipped, contrasts
from .flown import Flight
from .looked_at import Viewer
from .scripted_platform import CHECKS, CLOCK, LINK_LOSS, ScriptedPlatform, refused, reply_to
from .services_poses import services
from .station_scene import LINKS, TEXT, Scene, ScriptedLinks, scene

Pose = AsyncGenerator[str, None]
"""The names of what is shown, one after the other."""

RED = [
    LINK_LOSS,
    Check(
        Group.SENSORS, "position", Verdict.RED, "quality 0 % from nothing", "wait for a position, or check its sources"
    ),
    Check(
        Group.COMPONENTS, "driver", Verdict.RED, "faulty: the serial line has gone away", "look at it with 2, Health"
    ),
]
WRONG = TEXT.replace("after: [depart]", "after: [depart, nowhere]").replace("speed_m_s: 0.5", "speed_m_s: fast")


async def overview(here: Scene) -> Pose:
    """The overview, what may lie over any screen, and a vehicle that has fallen silent."""
    yield "waiting"
    await _problem(here)
    yield "overview"
    await _over(here, "question_mark", HelpScreen)
    await here.wait(lambda: any(each.lines for each in here.app.screen.query(Panel)))
    yield "help"
    await _leave(here)
    await here.press("ctrl+p")
    await here.wait(lambda: any(found.option_count for found in here.app.screen.query(OptionList)))
    yield "palette"
    await _leave(here)
    await _over(here, "a", YesNoQuestion)
    yield "abort"
    await _leave(here)
    here.platform.fly(is_armed=True)
    await here.press("space")
    await here.until("events", "emergency hold")
    await _over(here, "space", EmergencyQuestion)
    yield "emergency"
    await here.press("d")
    await here.wait(lambda: isinstance(here.app.focused, Input))
    yield "disarm"
    await _leave(here)
    here.platform.control = ControlState(holder="255", requested_by="254")
    here.platform.report("control", here.platform.control)
    await _over(here, "q", YesNoQuestion)
    yield "quit"
    await _leave(here)
    loop, here.platform.is_deaf = here.platform.loop, True
    here.station.now_s = lambda: loop.time() + 312.0  # type: ignore[misc]
    await here.until("title", "SILENT")
    yield "stale"
    await here.go("2")
    yield "stale_health"
    await here.go("3")
    yield "stale_mission"
    await here.pilot.resize_terminal(60, 20)
    await here.wait(lambda: "60 × 20" in here.shown("too_small"))
    yield "too_small"


async def health(here: Scene) -> Pose:
    """The components; what one of them can be told; a form; a question; an error in full."""
    await _problem(here)
    await here.go("2")
    await here.until("components", "pose_backup")
    yield "health"
    here.app.screen.query_one(ListPanel).point_at("ground_camera")
    await here.until("component", "no frame for 1.0 s")
    yield "component"
    await _over(here, "enter", ComponentMenu)
    await here.wait(lambda: bool(here.app.screen.query_one(ListPanel).chosen))
    yield "component_menu"
    await _leave(here)
    here.app.screen.query_one(ListPanel).point_at("autopilot")
    await _over(here, "enter", ComponentMenu)
    await here.wait(lambda: bool(here.app.screen.query_one(ListPanel).chosen))
    await here.press("end", "up", "enter")
    await here.wait(lambda: isinstance(here.app.screen, FunctionForm) and isinstance(here.app.focused, Input))
    here.app.screen.query_one(Input).value = "0"
    await here.press("enter")
    yield "function_form"
    await _leave(here)
    here.platform.answer_next(CommandComponent, refused("sweep.wall needs autopilot; pause it, or force the command"))
    await _over(here, "enter", ComponentMenu)
    await here.wait(lambda: bool(here.app.screen.query_one(ListPanel).chosen))
    await here.press("down", "enter")
    await here.shows(YesNoQuestion)
    yield "force"


async def mission(here: Scene) -> Pose:
    """The graph, the text with what is wrong in it, and the dialogues about files and single actions."""
    await here.go("3")
    here.platform.speak_every(0.5)
    await here.until("graph", "sweep")
    yield "mission_at_hand"
    await _problem(here)
    await here.until("graph", "running")
    await here.press("down", "right", "down")
    await here.until("detail", "follow_waypoints")
    yield "mission"
    await here.press("a")
    await here.shows(YesNoQuestion)
    yield "abort_action"
    await _leave(here)
    here.platform.answer_next(
        RequestAction,
        refused("motion is claimed by sweep.wall; pause or abort it first"),
        lambda request: reply_to(request, reason="command-7"),
    )
    await _over(here, "d", SingleAction)
    await here.wait(lambda: bool(here.app.screen.query_one(ListPanel).chosen))
    yield "single_action"
    here.app.screen.query_one(ListPanel).point_at("go_to")
    await here.press("enter")
    await here.wait(lambda: isinstance(here.app.focused, Input))
    here.app.screen.query_one("#field_position_m", Input).value = "4, 1, 2"
    await here.press("ctrl+s")
    await here.wait(lambda: any("refused" in str(line) for line in here.app.screen.query_one("#reply", Panel).lines))
    yield "single_action_form"
    await here.press("escape", "escape")
    await here.wait(lambda: here.app.screen is here.app.base)
    await _over(here, "o", OpenMission)
    await here.wait(lambda: bool(here.app.screen.query_one(ListPanel).chosen))
    yield "open_mission"
    await _leave(here)
    with TemporaryDirectory() as folder:
        async with aclosing(_text(here, Path(folder) / "wrong.yaml")) as texts:
            async for name in texts:
                yield name


async def _text(here: Scene, file: Path) -> Pose:
    """A mission with errors, as text, saved, and left without saving."""
    file.write_text(WRONG)
    await _over(here, "o", OpenMission)
    await here.wait(lambda: isinstance(here.app.focused, Input))
    here.app.screen.query_one(Input).value = str(file)
    await here.pilot.pause()
    await here.press("enter")
    await here.until("findings", "no task 'nowhere' here")
    yield "mission_errors"
    editor = here.app.screen.query_one(TextArea)
    editor.load_text(TEXT + "# mine\n")
    await here.until("findings", "no findings")
    yield "mission_text"
    await here.press("escape")
    await _over(here, "o", UnsavedQuestion)
    yield "unsaved"
    await _leave(here)
    await _over(here, "w", SaveMission)
    here.app.screen.query_one(Input).value = "hold.plan"
    await here.wait(lambda: any("Earth" in str(line) for line in here.app.screen.query_one("#said", Panel).lines))
    yield "save_mission"


async def flight(here: Scene) -> Pose:
    """The map and the charts of a flight."""
    here.platform.speak_every(0.5)
    await _read_back(here)
    flown = Flight(here)
    flown.begin()
    flown.fly(54.25)
    await here.go("4")
    await here.until("map", "5")
    yield "map"
    await here.press("plus", "plus", "f", "d")
    await here.until("profile", "┤")
    yield "map_followed"
    await here.go("5")
    await here.until("charts", "height")
    yield "data"
    await here.press("f", "down", "down", "down")
    flown.now_s += 12.0
    await here.wait(lambda: "FROZEN" in str(here.app.screen.query_one("#charts", Panel).border_title))
    yield "data_frozen"


async def sensors(here: Scene) -> Pose:
    """The topics: a pose, a picture, a plan view, one that is not there."""
    here.platform.speak_every(0.5)
    await here.until("title", "heron")
    viewer = Viewer(here.exchange, here.platform)
    await here.go("7")
    await here.until("topics", "pose")
    topics = here.app.screen.query_one("#topics", ListPanel)
    for topic, name in (("camera/ground", "picture"), ("pose", "sensors")):
        topics.point_at(topic)
        await here.wait(lambda topic=topic: topic in _watched(here))  # type: ignore[misc]
        viewer.tell_activity()
        viewer.fly(30.0)
        await here.until("fields", "ground" if name == "picture" else "position ned")
        here.app.screen.query_one("#fields", ListPanel).point_at("position_ned_m")
        yield name
    await _look_for(here, "obstacles")
    points = [(0.0, 0.0), *((4.0 + 0.05 * n, -3.0 + 0.2 * n) for n in range(30)), (-2.0, 1.0)]
    viewer.show("obstacles", ObstacleScan(points_ne_m=points), 1.0)
    await here.until("plot", "points")
    yield "scan"
    await here.press("escape")
    await _look_for(here, "nothing")
    await here.until("sight", "there is no such topic")
    yield "no_topic"


async def checks(here: Scene) -> Pose:
    """The pre-flight list with a red line, and the question about starting in spite of it."""
    here.platform.checks = [*CHECKS[:3], *RED, *CHECKS[6:], CLOCK]
    here.platform.speak_every(0.5)
    await _read_back(here)
    await here.go("8")
    await here.until("checks", "NAV_DLL_ACT")
    yield "checks"
    await _over(here, "o", TextQuestion)
    await here.wait(lambda: isinstance(here.app.focused, Input))
    yield "override"


async def events(here: Scene) -> Pose:
    """A long list, a search, and the question about a file."""
    await _problem(here)
    for number in range(200):
        here.platform.event(f"number {number}: a gust of {number % 9} m/s", Severity(3 + number % 4), "limiter")
    await here.go("9")
    await here.wait(lambda: any("number 199" in event.text for event in here.station.fleet.events))
    yield "events"
    await here.press("slash")
    await here.wait(lambda: isinstance(here.app.focused, Input))
    here.app.screen.query_one("#search", Input).value = "number 17"
    await here.until("filter", "11 of")
    yield "events_search"
    await here.enter()
    await _over(here, "e", TextQuestion)
    await here.wait(lambda: isinstance(here.app.focused, Input))
    yield "export"


async def fleet(here: Scene) -> Pose:
    """Three vehicles, of which two are marked and one asks for control; and the questions."""
    await _problem(here)
    for number, name in enumerate(("egret", "stork")):
        other = ScriptedPlatform(here.exchange, name, 20 + number)
        other.control = ControlState(holder="254")
        other.speak_every(0.5)
    here.platform.control = ControlState(holder="255", requested_by="254")
    here.platform.report("control", here.platform.control)
    await here.go("0")
    await here.until("vehicles", "stork")
    await here.press("m")
    await here.until("control", "requests it")
    yield "fleet"
    await _over(here, "h", YesNoQuestion)
    yield "fleet_order"
    await _leave(here)
    await here.press("down")
    await here.until("title", "egret 2/3")
    await _over(here, "t", YesNoQuestion)
    yield "take_over"
    await _leave(here)
    await _over(here, "n", TextQuestion)
    await here.wait(lambda: isinstance(here.app.focused, Input))
    yield "new_link"
    await _leave(here)
    await here.press("tab")
    await here.wait(lambda: getattr(here.app.focused, "id", "") == "links")
    await _over(here, "delete", YesNoQuestion)
    yield "close_link"
    await _leave(here)
    await here.go("1")
    await here.until("vehicles", "stork")
    yield "overview_of_three"


STATION: tuple[Callable[[Scene], Pose], ...] = (
    overview,
    health,
    mission,
    flight,
    sensors,
    checks,
    events,
    fleet,
)

GROUPS = (*(group.__name__ for group in STATION), services.__name__)


async def poses(
    size: tuple[int, int], theme: ThemeName = "dark", wanted: tuple[str, ...] = ()
) -> AsyncGenerator[tuple[str, Scene], None]:
    """Goes through them all, or through the groups that are wanted; each is settled when it is given."""
    for group in STATION:
        if wanted and group.__name__ not in wanted:
            continue
        configuration = Configuration(theme=theme)
        async with (
            scene(size=size, configuration=configuration, links=ScriptedLinks(*LINKS)) as here,
            aclosing(group(here)) as names,
        ):
            async for name in names:
                await settle(here)
                yield name, here
    if not wanted or services.__name__ in wanted:
        async with aclosing(services(size, theme)) as found:
            async for name, served in found:
                await settle(served)
                yield name, served


async def problems(here: Scene) -> list[str]:
    """What cannot be read where it is, or hardly, once everything is laid out."""
    found: list[str] = []
    for _ in range(25):
        faint = [each for each in contrasts(here.app) if each.ratio < READABLE]
        found = [*clipped(here.app), *(f"{each.text!r}: {each.colours}, contrast {each.ratio:.2f}" for each in faint)]
        if not found:
            break
        await settle(here)
    return found


async def settle(here: Scene) -> None:
    """Waits until what is shown is laid out, and no longer scrolls."""
    for _ in range(3):
        here.app.show_fleet()
        await here.pilot.pause(0.02)
    for each in here.app.screen.query(VerticalScroll):
        await here.wait(lambda each=each: not each.is_scrolling)  # type: ignore[misc]


async def _problem(here: Scene) -> None:
    here.platform.speak_every(0.5)
    await _read_back(here)
    await here.trouble_in_flight()


async def _read_back(here: Scene) -> None:
    """Waits until the mission at hand has been brought over."""
    await here.wait(lambda: any("read back" in event.text for event in here.station.fleet.events))


async def _over(here: Scene, key: str, kind: type[ModalScreen[object]] | type) -> None:
    """Opens a dialogue by its key."""
    await here.press(key)
    await here.shows(kind)


async def _leave(here: Scene) -> None:
    """Closes whatever lies over the screen."""
    await here.press("escape")
    await here.wait(lambda: here.app.screen is here.app.base)


async def _look_for(here: Scene, topic: str) -> None:
    """Types the full name of a topic that is not listed."""
    await here.press("slash")
    await here.wait(lambda: isinstance(here.app.focused, Input))
    here.app.screen.query_one("#topic_search", Input).value = topic
    await here.wait(lambda: _watched(here) == [topic])
    await here.enter()


def _watched(here: Scene) -> list[str]:
    return [want.topic for want in here.platform.watched.wants]
