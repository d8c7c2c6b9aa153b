"""An observer of flights: it knows the mission's file, the platform's rows and the log, and nothing of the executor.

It has a reading of the rules of its own, and tells where a flight has broken one.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from tests.common.mission.at_random.draw import clearance_m
from tests.common.mission.at_random.fly import Entry

Document = Mapping[str, Any]

MOVES = {
    "waiting": ("running", "skipped", "aborted"),
    "running": ("paused", "done", "failed", "skipped", "aborted"),
    "paused": ("running", "done", "failed", "skipped", "aborted"),
    "failed": ("waiting", "skipped", "aborted"),
}
"""What may follow what; nothing follows done, skipped and aborted."""
OPEN = ("running", "paused")
FINAL = ("done", "skipped", "aborted")
ENDED = (*FINAL, "failed")
SEVERITY = ("hold", "return", "land")
SEVERITIES = {"resume": "hold", "hold": "hold", "return": "return", "land": "land"}
"""How severe a contingency is, by what follows it."""
TOLD_MOVE = re.compile(r"(mission|[\w-]+(?:\.[\w-]+)?) (waiting|running|paused|done|failed|skipped|aborted)(?:: (.*))?")
TOLD_REPETITION = re.compile(r"([\w-]+): (\d+) of (\d+)")
TOLD_POLICY = re.compile(r"policy (hold|return|land): ")
TOLD_CONTINGENCY = re.compile(r"contingency ([\w-]+): ")
TOLD_FOLLOWS = re.compile(r"contingency ([\w-]+) (\w+); then (resume|hold|return|land)")
BEGINS = ("after", "when", "otherwise")
LATE_S = 0.01
PROGRESS_STEP = 0.05


class Item:
    """A task, an action, or (with an empty name) the mission, as its file says."""

    def __init__(self, name: str, options: Document) -> None:
        self.name = name
        self.after: list[str] = list(options.get("after", ()))
        self.deadline_s: float | None = options.get("deadline_s")
        own = options.get("on_failure")
        self.policy = None if own == "retry" else own
        self.times: int = (options.get("repeat") or {}).get("times", 1)
        self.done = 1
        """The repetition that it is in."""
        self.least = _least(options.get("when") or {})
        """Share of the battery that its guard wants."""
        self.attempts = 1 + (options.get("retries") or (1 if own == "retry" else 0))
        self.state = "waiting"
        self.since_s: float | None = None
        self.ran_s = 0.0

    def move(self, state: str, now_s: float) -> None:
        """It is told to be in another state."""
        if self.since_s is not None:
            self.ran_s += now_s - self.since_s
        self.since_s = now_s if state == "running" else None
        self.ran_s = 0.0 if state == "waiting" else self.ran_s
        self.state = state

    def ran(self, now_s: float) -> float:
        """How long it ran, pauses left out."""
        return self.ran_s + (now_s - self.since_s if self.since_s is not None else 0.0)


def _least(guard: Document) -> float:
    """The share of the battery that a guard wants."""
    if "not" in guard:
        return float(guard["not"]["battery"]["below"])
    parts = [one for one in (guard, *guard.get("all", ())) if "battery" in one]
    return float(parts[0]["battery"]["above"]) if parts else 0.0


def _names(policy: object, contingency: str) -> bool:
    """Whether what a file says is a policy that has a contingency run."""
    return isinstance(policy, dict) and policy.get("task") == contingency


def _actions(actions: Document) -> Iterator[tuple[str, Document]]:
    """The actions of a task, with the two that `arrive` stands for."""
    for name, action in actions.items():
        if "arrive" in action:
            yield f"{name}_return", action
            yield (
                name,
                {key: value for key, value in action.items() if key not in BEGINS} | {"after": [f"{name}_return"]},
            )
        else:
            yield name, action


class Observer:
    """Reads the log of one flight."""

    def __init__(self, document: Document, rows: Document) -> None:
        self.violations: list[str] = []
        self._rows = {"wait": {"claims": []}, **rows}
        self._document = document
        self._ready: Document = document.get("contingencies", {})
        self._items: dict[str, Item] = {"": Item("", {"deadline_s": document.get("deadline_s")})}
        for name, task in (*document["tasks"].items(), *self._ready.items()):
            definition = document["define"][task["use"]] if "use" in task else {}
            self._items[name] = Item(name, {**definition, **task})
            for own, action in _actions(task.get("actions") or definition["actions"]):
                self._items[f"{name}.{own}"] = Item(f"{name}.{own}", action)
        self._shown: dict[str, str] = {}
        self._is_unsure = False
        """The process ended in the middle of something, and it is not known what it still told."""
        self._kept: dict[str, Any] = {}
        self._kept_count = -1
        self._used: set[str] = set()
        self._working: dict[str, str] = {}
        """Action id to target, as the components see it."""
        self._capability: dict[str, str] = {}
        self._grant = ""
        self._starts: dict[str, int] = {}
        self._is_airborne = False
        self._has_pilot = self._is_pilot_told = self._is_pilot_kept = False
        self._severity = -1
        self._owed = ""
        """What should follow a contingency that has ended."""
        self._failed: list[str] = []
        self._progress: dict[str, list[float]] = {}
        self._is_disturbed = False
        self._given_up: set[str] = set()
        self._battery = 1.0
        self._now_s = 0.0

    def watch(self, log: Sequence[Entry]) -> list[str]:
        """The rules that a flight has broken, each with its time."""
        for entry in log:
            self._now_s = entry.t_s
            self._watch_deadlines()
            getattr(self, f"_{entry.kind.replace(' ', '_')}")(entry)
        return self.violations

    def _wrong(self, what: str) -> None:
        self.violations.append(f"{self._now_s:.2f} s: {what}")

    # --- what the executor shows and tells ---

    def _step(self, entry: Entry) -> None:
        self._compare()

    def _states(self, entry: Entry) -> None:
        self._shown = entry.data
        if self._is_unsure:  # back from disk: what was running waits for its component, the rest is as it was
            self._is_unsure = False
            for name, item in self._items.items():
                shown, kept = self._shown.get(name), self._kept_state(name)
                if shown is None and self._is_ready(name) and name not in self._kept:
                    continue
                if shown is None:
                    self._wrong(f"{name or 'the mission'} is lost by a restart")
                elif kept in FINAL and shown != kept:
                    self._wrong(f"{name or 'the mission'} was {kept} before a restart, and is {shown} after it")
                item.state, item.since_s = kept, self._now_s if kept == "running" else None
                item.ran_s = self._kept.get(name, {}).get("ran_s", 0.0)
                item.done = self._kept.get(name, {}).get("repetition", 0) or 1
                if kept == "running" and "." in name:
                    item.move("paused", self._now_s)

    def _compare(self) -> None:
        """What was told of the last step adds up to what is shown."""
        if not self._shown or self._is_unsure:
            return
        for name, state in self._shown.items():
            if self._items[name].state != state:
                self._wrong(f"{name or 'the mission'} is shown {state}, and told to be {self._items[name].state}")
                self._items[name].state = state
        for name in self._failed:
            if "." in name and name.partition(".")[0] in self._failed:
                continue  # the whole task has failed, as by its deadline: its own policy governs
            policy = self._policy(name)
            if self._shown[name] == "failed" and policy not in ("continue", "skip") and self._shown[""] == "running":
                self._wrong(f"{name} failed, its policy is {policy}, and the mission runs on")
        self._failed.clear()
        for name in self._ready:
            if self._shown.get(name) in OPEN and self._shown[""] == "running":
                self._wrong(f"the contingency {name} is {self._shown[name]}, and the mission runs on")
        if self._owed and self._is_airborne and (self._owed != "resume" or self._shown[""] == "paused"):
            self._wrong(f"{self._owed} should follow a contingency, and does not")
        self._owed = ""
        for action_id, target in self._working.items():
            if not target.startswith("policy.") and self._shown.get(target) != "running":
                self._wrong(f"{action_id} is worked at, and is {self._shown.get(target)}")
        if self._has_pilot and not self._is_pilot_kept:
            self._wrong("a pilot has control, and that is not on disk")
        if self._is_airborne and not self._has_pilot and not self._grant:
            self._wrong("in the air nobody owns motion")

    def _told(self, entry: Entry) -> None:
        if found := TOLD_POLICY.match(entry.what):
            self._answer(found[1])
            self._owed = ""
        elif found := TOLD_CONTINGENCY.match(entry.what):
            self._restart(found[1])
        elif found := TOLD_FOLLOWS.fullmatch(entry.what):
            self._owed = found[3]
            if found[3] == "resume":
                self._severity = -1
            if self._shown.get(found[1]) not in ENDED:
                self._wrong(f"what follows {found[1]} is done, and it is {self._shown.get(found[1])}")
        elif (found := TOLD_REPETITION.fullmatch(entry.what)) and (item := self._items.get(found[1])):
            item.done += 1
            if int(found[2]) != item.done or item.done > item.times or item.state != "running":
                self._wrong(f"{item.name} is {item.state}, and repeated as {found[2]} of {item.times}")
            for one in self._items.values():
                if one.name.startswith(item.name + ".") and one.state != "aborted":
                    one.move("waiting", self._now_s)
                    self._starts.pop(one.name, None)
                    self._progress.pop(one.name, None)
        elif (found := TOLD_MOVE.fullmatch(entry.what)) and (item := self._items.get(found[1].replace("mission", ""))):
            state = found[2]
            if state not in MOVES.get(item.state, ()):
                self._wrong(f"{item.name or 'the mission'} goes from {item.state} to {state}")
            item.move(state, self._now_s)
            if state == "failed" and item.name:
                self._failed.append(item.name)
            if item.name and self._kept_state(item.name) != self._shown.get(item.name, "lost"):
                self._wrong(f"{item.name} is told to be {state} before that is on disk")

    def _answer(self, policy: str) -> None:
        severity = SEVERITY.index(policy)
        if severity < self._severity:
            self._wrong(f"the policy {policy} follows {SEVERITY[self._severity]}")
        self._severity = severity

    def _restart(self, name: str) -> None:
        """A contingency begins, perhaps not for the first time; what ends it is more severe."""
        wanted = {policy["then"] for policy in self._document.values() if _names(policy, name)}
        self._is_disturbed = True
        self._answer(min((SEVERITIES[then] for then in wanted), key=SEVERITY.index))
        for target, item in self._items.items():
            if target == name or target.startswith(f"{name}."):
                item.move("waiting", self._now_s)
                item.done = 1
                self._starts.pop(target, None)
                self._progress.pop(target, None)

    def _is_ready(self, name: str) -> bool:
        """Whether it is a contingency, or a part of one."""
        return name.partition(".")[0] in self._ready

    def _persist(self, entry: Entry) -> None:
        self._kept = {}
        for program in entry.data["programs"]:
            self._kept |= program["items"] | ({"": program["own"]} if program["name"] == "mission" else {})
        self._kept_count = entry.data["count"]
        self._is_pilot_kept = entry.data.get("has_pilot", False)

    def _kept_state(self, name: str) -> str:
        return str(self._kept.get(name, {}).get("state", "lost"))

    def _grants(self, entry: Entry) -> None:
        self._grant = entry.what
        if self._has_pilot and entry.what:
            self._wrong(f"motion is granted to {entry.what}, and a pilot has control")

    # --- what it asks of components ---

    def _start(self, entry: Entry) -> None:
        action_id, request = entry.what, entry.data
        target, _, number = action_id.partition("#")
        self._may_work(action_id, target, request.capability)
        if action_id in self._used:
            self._wrong(f"{action_id} is used twice")
        self._used.add(action_id)
        if int(number) > self._kept_count:
            self._wrong(f"{action_id} is begun before its number is on disk")
        self._capability[action_id] = request.capability
        self._inside(action_id, request.arguments)
        if target.startswith("policy."):
            return
        item, task = self._items[target], self._items[target.partition(".")[0]]
        if self._kept_state(target) != "running":
            self._wrong(f"{target} is begun, and is {self._kept_state(target)} on disk")
        for name in [*task.after, *(f"{task.name}.{one}" for one in item.after)]:
            state = self._shown[name]
            is_left = name in self._given_up or self._policy(name) == "continue"
            if state not in FINAL and not (state == "failed" and is_left):
                self._wrong(f"{target} is begun before {name}, which is {state}")
        if self._battery <= item.least and not self._starts.get(target):
            self._wrong(
                f"{target} is begun with {self._battery:.2f} of the battery, and its guard wants {item.least:g}"
            )
        self._starts[target] = self._starts.get(target, 0) + 1
        task_attempts = task.attempts + (self._document.get("on_failure") == "retry" and task.attempts == 1)
        if not self._is_disturbed and self._starts[target] > item.attempts * task_attempts * task.times:
            self._wrong(f"{target} is begun {self._starts[target]} times")

    def _resume(self, entry: Entry) -> None:
        self._may_work(entry.what, entry.what.partition("#")[0], self._capability[entry.what])

    def _may_work(self, action_id: str, target: str, capability: str) -> None:
        claims = self._rows[capability]["claims"]
        if self._has_pilot:
            self._wrong(f"{action_id} is begun, and a pilot has control")
        if "motion" in claims and self._grant != action_id:
            self._wrong(f"{action_id} moves the vehicle, and motion is {self._grant or 'nobody'}'s")
        for other in self._working:
            shared = [one for one in claims if one in self._rows[self._capability[other]]["claims"]]
            if shared and other != action_id:
                self._wrong(f"{action_id} and {other} both have {shared[0]}")
        running = [name for name in self._ready if self._shown.get(name) in OPEN]
        if running and target.partition(".")[0] not in running:
            self._wrong(f"{action_id} is begun, and the contingency {running[0]} is under way")
        if not target.startswith("policy."):
            names = (target.partition(".")[0], target)
            for name in names if self._is_ready(target) else ("", *names):
                if self._shown[name] != "running":
                    self._wrong(f"{action_id} is begun, and {name or 'the mission'} is {self._shown[name]}")

    def _inside(self, action_id: str, arguments: Document) -> None:
        """No waypoint is outside the fence; in NED, y of the frame and height are turned round."""
        fence = self._document.get("geofence")
        if not fence:
            return
        for x, east, down in arguments.get("waypoints_ned_m", ()):
            corners = [(float(a), float(b)) for a, b in fence["polygon_m"]]
            if clearance_m(corners, (x, -east)) < -1e-3 or -down > fence["ceiling_m"] + 1e-3:
                self._wrong(f"{action_id} leads to {x:.1f}, {-east:.1f}, {-down:.1f}, outside the fence")

    def _pause(self, entry: Entry) -> None:
        """What comes of it is seen at the component."""

    _cancel = _pause

    # --- what is seen of components and vehicle ---

    def _works(self, entry: Entry) -> None:
        self._working[entry.what] = entry.what.partition("#")[0]

    def _rests(self, entry: Entry) -> None:
        self._working.pop(entry.what, None)

    _ends = _rests

    def _reported(self, entry: Entry) -> None:
        target = entry.what.partition("#")[0]
        before = self._progress.get(target, [self._kept.get(target, {}).get("progress", 0.0)])
        self._progress[target] = [before[-1], entry.data]

    def _airborne(self, entry: Entry) -> None:
        self._is_airborne = True

    def _touches_down(self, entry: Entry) -> None:
        self._is_airborne, self._severity = False, -1

    _landed = _touches_down

    # --- what befalls it ---

    def _battery_is(self, entry: Entry) -> None:
        self._battery = entry.data

    def _spins(self, entry: Entry) -> None:
        self._wrong("the executor has done nothing at its own time, and would be woken for ever")

    def _breaks(self, entry: Entry) -> None:
        self._wrong(f"the executor has refused a fact: {entry.what}")

    def _command(self, entry: Entry) -> None:
        self._severity = -1
        self._is_disturbed |= entry.what != "start"
        verb, _, target = entry.what.partition(" ")
        if verb == "abort":  # what has failed stays failed, and is no longer waited for
            self._given_up |= {name for name in self._items if name == target or name.startswith(f"{target}.")}
        if entry.what == "resume":
            self._has_pilot = False

    def _refused(self, entry: Entry) -> None:
        """Nothing has changed."""

    def _refused_and_changed(self, entry: Entry) -> None:
        self._wrong(f"{entry.what!r} was refused ({entry.data}), and something has changed")

    def _pilot(self, entry: Entry) -> None:
        is_on = entry.what == "on"
        if is_on and not self._is_pilot_told:
            self._has_pilot = True
        self._is_pilot_told = is_on
        self._severity = -1
        self._is_disturbed = True

    def _emergency(self, entry: Entry) -> None:
        self._severity = -1
        self._is_disturbed = True

    def _condition(self, entry: Entry) -> None:
        self._is_disturbed = True

    _clears = _condition

    def _restarts(self, entry: Entry) -> None:
        for target, reported in self._progress.items():
            kept, task = self._kept.get(target, {}), target.partition(".")[0]
            times = self._items[task].done if task in self._items else 1
            if (self._kept.get(task, {}).get("repetition") or 1) > times:
                continue  # it was to be done once more, which nobody was told of any more
            if kept.get("state") == "running" and all(
                abs(kept.get("progress", 0.0) - one) > PROGRESS_STEP + 1e-6 for one in reported
            ):
                self._wrong(f"{target} had come to {reported[-1]:.2f}, and {kept.get('progress', 0.0):.2f} is on disk")
        self._owed = ""
        self._failed.clear()
        self._working.clear()
        self._progress.clear()
        self._shown = {}
        self._grant, self._severity = "", -1
        self._has_pilot = self._is_pilot_told = self._is_pilot_kept  # a report may be lost with the process
        self._is_unsure = self._is_disturbed = True

    def _restarted(self, entry: Entry) -> None:
        """What it shows next is compared with what was on disk."""

    def _over(self, entry: Entry) -> None:
        self._compare()
        if entry.what or entry.data:
            self._wrong(f"at the end the policy is {entry.what or 'none'}, and {entry.data} is worked at")
        for name, item in self._items.items():
            if item.state not in ENDED and not (self._is_ready(name) and item.state == "waiting"):
                self._wrong(f"at the end {name or 'the mission'} is {item.state}")

    # --- what the file says ---

    def _policy(self, name: str) -> str:
        """What the failure of an item leads to, its attempts being used up."""
        if self._is_ready(name):
            return "continue"  # and then what its policy says follows
        names = [name, name.partition(".")[0]] if "." in name else [name]
        own = next((policy for one in names if (policy := self._items[one].policy) is not None), None)
        default = self._document.get("on_failure", "hold")
        return str(own or ("hold" if default == "retry" else default))

    def _watch_deadlines(self) -> None:
        if self._is_unsure:
            return
        for name, item in self._items.items():
            if item.deadline_s is not None and item.ran(self._now_s) > item.deadline_s + LATE_S:
                self._wrong(f"{name or 'the mission'} runs on after its deadline of {item.deadline_s:g} s")
                item.deadline_s = None
