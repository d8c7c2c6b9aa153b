"""Draws missions: valid ones with everything that the language has, and the same with one thing wrong."""

from collections.abc import Callable
from math import cos, hypot, pi, sin
from random import Random
from typing import Any, NamedTuple

import yaml

Document = dict[str, Any]
Point = tuple[float, float]

MANOEUVRES = ("hold", "return", "land", "abort")
MILD = ("continue", "skip", "retry")
POLICIES = (*MILD, *MANOEUVRES)
HEIGHTS_M = (1.0, 5.5)
DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


class Drawn(NamedTuple):
    """A mission file."""

    text: str
    flaw: str
    """What is wrong with it, by name; empty where nothing is meant to be."""


def draw_mission(random: Random) -> Drawn:
    """A mission file; of four, three are meant to be right."""
    document = _Draft(random).document()
    if random.random() < 0.75:
        return Drawn(_text(document), "")
    flaw = random.choice(sorted(FLAWS))
    made = FLAWS[flaw](document, random)
    return Drawn(made if isinstance(made, str) else _text(made), flaw)


def _text(document: Document) -> str:
    return str(yaml.dump(document, Dumper=DUMPER, sort_keys=False, width=1000))


class _Draft:
    """One mission in the making."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self._fence: list[Point] = []
        self._definitions: Document = {}

    def document(self) -> Document:
        """A whole mission."""
        random = self._random
        made: Document = {"mission": "drawn", "frame": "hold", **self._policies()}
        if random.random() < 0.8:
            self._fence = _convex(random)
            made["geofence"] = {"polygon_m": [list(corner) for corner in self._fence], "ceiling_m": 8}
        if random.random() < 0.2:
            made["deadline_s"] = random.choice([240, 600])
        climb = self._step("depart", {}) if random.random() < 0.15 else self._step("take_off", {"height_m": 2})
        tasks: Document = {"depart": {"actions": {"climb": climb}}}
        exchange, free = "depart", ["depart"]
        for number in range(random.randint(1, 5)):
            name = f"task{number}"
            if random.random() < 0.75:
                tasks[name] = self._task(is_guided=True, after=[exchange, *self._some(free)])
                exchange = name
            else:
                tasks[name] = self._task(is_guided=False, after=self._some(free))
            free.append(name)
        home = {"home": self._step("return_home", {})} if random.random() < 0.6 else {}
        down = self._step("land" if home or random.random() < 0.4 else "arrive", {}, after=[*home])
        tasks["recover"] = {"after": sorted({exchange, *self._some(free)}), "actions": {**home, "down": down}}
        ready = self._contingencies(made) if random.random() < 0.4 else {}
        if self._definitions:
            made["define"] = self._definitions
        return made | {"tasks": tasks} | ready

    def _contingencies(self, made: Document) -> Document:
        """One or two tasks that the mission has ready, and the policies that name them."""
        random, ready = self._random, {}
        for name in ("refuge", "alcove")[: random.randint(1, 2)]:
            task = self._use() if random.random() < 0.2 else {"actions": self._led()} | self._options(0.2, (100, 200))
            for item in (task, *task.get("actions", {}).values()):
                if item.get("on_failure") in MANOEUVRES:
                    item["on_failure"] = random.choice(MILD)
            if "actions" in task and random.random() < 0.2:
                movers = [one for one in task["actions"] if one.startswith("go")]
                task["actions"]["down"] = self._step("land", {}, after=sorted(movers)) | {"on_failure": "continue"}
            ready[name] = task
        for key, ends in (
            ("on_link_loss", ("resume", "resume", "hold", "return", "land")),
            ("on_low_battery", ("return", "land")),
            ("on_obstacle", ("resume", "hold", "land")),
            ("on_component_fault", ("resume", "hold", "return")),
        ):
            if random.random() < 0.6:
                made[key] = {"task": random.choice(sorted(ready)), "then": random.choice(ends)}
        return {"contingencies": ready}

    def _policies(self) -> Document:
        random, found = self._random, {}
        for key, possible in (
            ("on_failure", POLICIES),
            ("on_link_loss", ("continue", *MANOEUVRES)),
            ("on_low_battery", ("return", "land")),
            ("on_pose_lost", ("continue", "land")),
            ("on_obstacle", ("continue", "hold", "land")),
            ("on_restart", ("continue", "continue", "continue", "hold", "land")),
        ):
            if random.random() < 0.6:
                found[key] = random.choice(possible)
        return found | {"hold_s": random.choice([0, 5, 20])}

    def _task(self, *, is_guided: bool, after: list[str]) -> Document:
        random = self._random
        if is_guided and random.random() < 0.25:
            return self._use() | {"after": sorted({*after})}
        actions = self._led() if is_guided else self._waits("", random.randint(1, 3))
        repeat: Document = {}
        if is_guided and random.random() < 0.3 and all(_is_plan(action) for action in actions.values()):
            repeat["flown_by"] = "autopilot"
        if random.random() < 0.2:
            repeat["repeat"] = {"times": random.randint(2, 3)}
            if random.random() < 0.5:
                repeat["repeat"]["until"] = {"battery": {"below": 0.5}}
        return {"after": sorted({*after}), "actions": actions, **self._options(0.2, (100, 200)), **repeat}

    def _led(self) -> Document:
        """Actions that move the vehicle, one after the other, and others beside them."""
        random, actions, before = self._random, {}, ""
        for number in range(random.randint(1, 3)):
            name = f"go{number}"
            kind = random.choice(["go_to", "go_to", "follow_waypoints", "hold", "survey", "transit"])
            actions[name] = self._step(kind, self._arguments(kind), after=[before] if before else [])
            before = name
        if random.random() < 0.5:
            name = random.choice(sorted(actions))
            arguments: Document = random.choice([{"every_m": 0.5}, {"every_s": 1}, {"every_s": 0.5, "count": 5}])
            actions["photos"] = self._step("record_images", {"camera": "ground", **arguments}) | {"until": name}
        if random.random() < 0.4:
            actions |= self._waits(random.choice(sorted(actions)), 1)
        return dict(random.sample(sorted(actions.items()), len(actions)))

    def _waits(self, after: str, number: int) -> Document:
        found: Document = {}
        for index in range(number):
            before = [name for name in (after, f"rest{index - 1}" if index else "") if name]
            duration_s = self._random.choice([0, 0.5, 3, 12])
            found[f"rest{index}"] = self._step("wait", {"duration_s": duration_s}, after=self._some(before))
        return found

    def _use(self) -> Document:
        """A task by a definition, with a point of its own."""
        if not self._definitions:
            self._definitions["leg"] = {
                "parameters": {"to": {"kind": "point"}, "speed": {"kind": "number", "default": 0.5, "unit": "m/s"}},
                "actions": {
                    "go": {"go_to": {"position_m": "$to", "speed_m_s": "${speed}"}},
                    "stay": {"hold": {"duration_s": 2}, "after": ["go"]},
                },
            }
        values: Document = {"to": self._position()}
        if self._random.random() < 0.5:
            values["speed"] = 1.5
        return {"use": "leg", "with": values}

    def _step(self, capability: str, arguments: Document, after: list[str] | None = None) -> Document:
        return {capability: arguments, **({"after": after} if after else {}), **self._options(0.15)}

    def _options(self, share: float, deadlines_s: tuple[float, ...] = (30, 60)) -> Document:
        random = self._random
        found: Document = {}
        if random.random() < share:
            found["on_failure"] = random.choice(POLICIES)
        if random.random() < share:
            found["retries"] = random.randint(1, 2)
        if random.random() < 2 * share:
            found["deadline_s"] = random.choice(deadlines_s)
        if random.random() < share:
            found["when"] = self._guard(random.choice([0.3, 0.6]))
            found["otherwise"] = random.choice(["skip", "fail", "wait"])
            if found["otherwise"] == "wait":
                found["deadline_s"] = deadlines_s[-1]
        if random.random() < share / 3:
            found["silence"] = {"expected_s": random.choice([8, 25])}
        return found

    def _guard(self, least: float) -> Document:
        """Holds while more than this share of the battery is left."""
        enough: Document = {"battery": {"above": least}}
        low = {"height_m": {"below": 50}}
        return self._random.choice([enough, enough, {"not": {"battery": {"below": least}}}, {"all": [enough, low]}])

    def _arguments(self, kind: str) -> Document:
        random = self._random
        if kind == "hold":
            return {"duration_s": random.choice([0.5, 4])}
        flight: Document = {"speed_m_s": random.choice([0.5, 1, 2.5])}
        if random.random() < 0.3:
            flight["heading"] = random.choice(["hold", 90, {"look_at": [1, 2, 3]}])
        if kind == "go_to":
            return {"position_m": self._position(), **flight}
        if kind == "transit":
            height_m = {"height_m": 3} if random.random() < 0.5 else {}
            return {"to_m": [self._position()[:2] for _ in range(random.randint(1, 3))], **height_m, **flight}
        if kind == "survey":
            return {"area_m": self._area(), "spacing_m": random.choice([0.7, 1.2]), "height_m": 2.5, **flight}
        return {"waypoints_m": [self._position() for _ in range(random.randint(1, 4))], **flight}

    def _position(self) -> list[float]:
        random = self._random
        while True:
            x, y = random.uniform(-12, 12), random.uniform(-12, 12)
            if not self._fence or clearance_m(self._fence, (x, y)) > 0.6:
                return [round(x, 2), round(y, 2), round(random.uniform(*HEIGHTS_M), 2)]

    def _area(self) -> list[list[float]]:
        """A small rectangle inside the fence."""
        random = self._random
        while True:
            x, y, _ = self._position()
            dx, dy = random.uniform(0.5, 1.5), random.uniform(0.5, 1.5)
            corners = [[x - dx, y - dy], [x + dx, y - dy], [x + dx, y + dy], [x - dx, y + dy]]
            if not self._fence or all(clearance_m(self._fence, (a, b)) > 0.6 for a, b in corners):
                return [[round(a, 2), round(b, 2)] for a, b in corners]

    def _some(self, names: list[str]) -> list[str]:
        return [name for name in names if self._random.random() < 0.4]


def _is_plan(action: Document) -> bool:
    """Whether an action moves nothing, or along a way that an autopilot knows."""
    if "hold" in action:
        return False
    arguments = next((value for value in action.values() if isinstance(value, dict)), {})
    return arguments.get("heading", 0) not in ("hold", {"look_at": [1, 2, 3]})


def _convex(random: Random) -> list[Point]:
    """The corners of a convex polygon around home."""
    number, turn = random.randint(3, 7), random.uniform(0, pi)
    radius_m = random.uniform(8, 14)
    return [
        (round(radius_m * cos(turn + 2 * pi * i / number), 2), round(radius_m * sin(turn + 2 * pi * i / number), 2))
        for i in range(number)
    ]


def clearance_m(corners: list[Point], point: Point) -> float:
    """How far a point is inside a polygon; negative outside. Even-odd rule, and the distance to the nearest side."""
    is_inside, nearest_m = False, float("inf")
    x, y = point
    for (ax, ay), (bx, by) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            is_inside = not is_inside
        dx, dy = bx - ax, by - ay
        t = max(0.0, min(1.0, ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)))
        nearest_m = min(nearest_m, hypot(x - ax - t * dx, y - ay - t * dy))
    return nearest_m if is_inside else -nearest_m


# --- one thing wrong ---


def _any_action(document: Document, random: Random) -> Document:
    found = [action for task in document["tasks"].values() for action in task.get("actions", {}).values()]
    return random.choice(found)


def _tasks_in_a_circle(document: Document, random: Random) -> Document:
    document["tasks"]["depart"]["after"] = ["recover"]
    return document


def _actions_in_a_circle(document: Document, random: Random) -> Document:
    actions = document["tasks"]["recover"]["actions"]
    actions["a"] = {"wait": {"duration_s": 1}, "after": ["b"]}
    actions["b"] = {"wait": {"duration_s": 1}, "after": ["a"]}
    return document


def _unknown_capability(document: Document, random: Random) -> Document:
    action = _any_action(document, random)
    action[random.choice(["take_of", "fly", "dive", "Land"])] = {}
    return document


def _unknown_key(document: Document, random: Random) -> Document:
    random.choice([document, document["tasks"]["recover"]])["on_failiure"] = "land"
    return document


def _unknown_predecessor(document: Document, random: Random) -> Document:
    random.choice([document["tasks"]["recover"], document["tasks"]["recover"]["actions"]["down"]])["after"] = ["nobody"]
    return document


def _outside_the_fence(document: Document, random: Random) -> Document:
    document["geofence"] = {"polygon_m": [[-2, -2], [2, -2], [2, 2], [-2, 2]], "ceiling_m": 8}
    far = {"go_to": {"position_m": [random.choice([1.9, 3.0, 400.0]), 0, 2]}, "after": ["far0"]}
    document["tasks"]["far"] = {
        "after": ["depart"],
        "actions": {"far0": {"wait": {"duration_s": 1}}, "far1": far},
    }
    document["tasks"]["recover"]["after"] = ["far"]
    return document


def _two_at_once(document: Document, random: Random) -> Document:
    document["tasks"]["beside"] = {"after": ["depart"], "actions": {"go": {"go_to": {"position_m": [0, 0, 2]}}}}
    document["tasks"]["other"] = {"after": ["depart"], "actions": {"go": {"go_to": {"position_m": [0, 0, 3]}}}}
    return document


def _wrong_kind(document: Document, random: Random) -> Document:
    height = random.choice([{"height_m": "high"}, {}, [1.5], {"height_m": True}, {"height_m": [2]}, "up"])
    document["tasks"]["depart"]["actions"]["climb"] = {"take_off": height}
    return document


def _out_of_bounds(document: Document, random: Random) -> Document:
    _any_action(document, random)["retries"] = random.choice([-1, 101, 0.5])
    return document


def _too_high(document: Document, random: Random) -> Document:
    document["tasks"]["depart"]["actions"]["climb"] = {"take_off": {"height_m": 9.5}}
    document["geofence"] = {"polygon_m": [[-9, -9], [9, -9], [9, 9], [-9, 9]], "ceiling_m": 9}
    return document


def _too_fast(document: Document, random: Random) -> Document:
    document["tasks"]["fast"] = {
        "after": ["depart"],
        "actions": {"go": {"go_to": {"position_m": [0, 0, 2], "speed_m_s": random.choice([3.1, 20])}}},
    }
    return document


def _too_long(document: Document, random: Random) -> Document:
    document["tasks"]["recover"]["actions"]["down"]["after"] = ["stay"]
    document["tasks"]["recover"]["actions"]["stay"] = {"hold": {"duration_s": 14_000}}
    return document


def _too_short(document: Document, random: Random) -> Document:
    action = document["tasks"]["recover"]["actions"]["down"]
    action["deadline_s"] = 0.5
    return document


def _no_such_camera(document: Document, random: Random) -> Document:
    record = {"record_images": {"camera": "sky", "every_s": 1, "count": 2}}
    document["tasks"]["recover"]["actions"]["sky"] = record
    return document


def _no_such_frame(document: Document, random: Random) -> Document:
    document["frame"] = random.choice(["hild", "", 3])
    return document


def _endless(document: Document, random: Random) -> Document:
    document["tasks"]["recover"]["actions"]["down"]["after"] = ["stay"]
    document["tasks"]["recover"]["actions"]["stay"] = {"hold": {}, "until": random.choice(["stay", "none"])}
    return document


def _use_without_values(document: Document, random: Random) -> Document:
    document["define"] = {
        "leg": {"parameters": {"to": {"kind": "point"}}, "actions": {"go": {"go_to": {"position_m": "$to"}}}}
    }
    values = random.choice([{}, {"to": "there"}, {"to": [1, 2, 3], "too": 1}])
    document["tasks"]["use"] = {"use": random.choice(["leg", "log"]), "with": values, "after": ["depart"]}
    return document


def _key_twice(document: Document, random: Random) -> str:
    return _text(document) + random.choice(["mission: again\n", "tasks: {}\n"])


def _no_yaml(document: Document, random: Random) -> str:
    return _text(document) + random.choice(["  : [", "\t- x\n", "a: 'b\n", "x: &a 1\n", "x: !tag 1\n"])


Flaw = Callable[[Document, Random], Document | str]

FLAWS: dict[str, Flaw] = {
    "tasks in a circle": _tasks_in_a_circle,
    "actions in a circle": _actions_in_a_circle,
    "an unknown capability": _unknown_capability,
    "an unknown key": _unknown_key,
    "an unknown predecessor": _unknown_predecessor,
    "a position outside the fence": _outside_the_fence,
    "two motions at once": _two_at_once,
    "a value of a wrong kind": _wrong_kind,
    "a value out of bounds": _out_of_bounds,
    "too high": _too_high,
    "too fast": _too_fast,
    "more energy than there is": _too_long,
    "a deadline that cannot be met": _too_short,
    "a camera that there is not": _no_such_camera,
    "a frame that there is not": _no_such_frame,
    "an end that nobody brings": _endless,
    "a use without its values": _use_without_values,
    "a key twice": _key_twice,
    "no YAML": _no_yaml,
}
"""Each takes a right mission and makes one thing wrong, so that no platform may fly it."""
