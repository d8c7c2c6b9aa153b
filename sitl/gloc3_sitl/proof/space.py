"""Invariants of space: fence, floor, pose and passed waypoints, judged by the truth."""

from math import dist, hypot, inf
from typing import Any, Final

from gloc3.evaluation.requested_path import RequestedFlight
from gloc3.messages.envelope import Envelope
from gloc3.messages.vehicle import Pose
from gloc3.mission.model.messages import ActionStatus
from gloc3.mission.model.states import ActionState
from gloc3_sitl.autopilot.verdict import Author
from gloc3_sitl.flight.path_error import PASSED_M
from gloc3_sitl.proof.invariant import FlightFacts, FlownMission, Invariant, TrueMoment

REACTION_S: Final = 0.5
"""So long the vehicle may go on before it brakes."""
CAUGHT_S: Final = 2.0
"""So long after a pilot the speed is his still: the autopilot's own fence brakes what he has flown towards it."""
FLOOR_M: Final = 0.3
LEAST_STD_M: Final = 0.02
"""A smaller standard deviation than this is not held against a pose: the model of the body is no better."""
SIGMAS: Final = 4.0
DISHONEST_S: Final = 0.3
CRASH_M_S: Final = 2.0
"""What comes down on the ground faster than this has crashed."""
_HISTORY_S: Final = 3.0


class InsideFence(Invariant):
    """The true position against the mission's fence."""

    name = "inside_fence"
    sentence = (
        "Under way the vehicle stays inside the mission's fence and below its ceiling, but for the distance in which it "
        "stops; a pilot with the transmitter in hand may fly where he likes, also so fast that the autopilot's failsafe "
        "stops it late, and what flies on rotors is not judged while its only inertial unit is gone or late, or its "
        "satellites are in wind, nor what dives without its companion, or was so until a moment ago."
    )

    def __init__(self, facts: FlightFacts) -> None:
        super().__init__(facts)
        self._crossed_m_s: float | None = None
        self._is_excused = False
        """Whether a pilot has flown it out, or nobody could steer it."""
        self._piloted_s = -inf

    def observe(self, moment: TrueMoment) -> None:
        """Judges one moment."""
        if _is_pilots(moment):
            self._piloted_s = moment.t_s
        fence = self.facts.mission.fence
        clearance_m = 0.0 if fence is None else fence.clearance_m(moment.position_ned_m)
        if clearance_m >= 0.0:
            self._crossed_m_s, self._is_excused = None, False
            return
        if self._crossed_m_s is None:
            self._crossed_m_s = moment.speed_m_s
        is_carried = self.facts.is_out_of_control(moment.t_s) or self.facts.drifts(moment.t_s)
        is_caught = moment.mode_author is Author.FAILSAFE and moment.t_s - self._piloted_s <= CAUGHT_S
        self._is_excused |= _is_pilots(moment) or is_caught or is_carried
        if self._is_excused or not moment.is_under_way:
            return
        speed = self._crossed_m_s
        stopping_m = REACTION_S * speed + speed * speed / (2.0 * self.facts.platform.limits.acceleration_m_s2)
        if -clearance_m > stopping_m + 0.05:
            self.break_at(
                moment.t_s,
                f"{-clearance_m:.2f} m outside the fence, which it crossed at {speed:.2f} m/s: it stops in {stopping_m:.2f} m",
            )


def _is_pilots(moment: TrueMoment) -> bool:
    """Whether a pilot with a transmitter flies."""
    return moment.has_transmitter and moment.mode_author is Author.PILOT


class AboveFloor(Invariant):
    """The true depth against the floor of the water."""

    name = "above_floor"
    sentence = f"Under way a diving vehicle stays {FLOOR_M:g} m above the floor of the water."

    def observe(self, moment: TrueMoment) -> None:
        """Judges one moment."""
        above_m = -moment.position_ned_m[2] - self.facts.floor_height_m
        if moment.is_under_way and above_m < FLOOR_M and not _is_pilots(moment):
            self.break_at(moment.t_s, f"{above_m:.2f} m above the floor, {FLOOR_M:g} m is the least")


class PoseHonest(Invariant):
    """The pose against the truth, with the standard deviation that it claims."""

    name = "pose_honest"
    sentence = (
        f"A pose that says that it is valid is not farther off the truth than {SIGMAS:g} of its standard deviations for "
        f"{DISHONEST_S:g} s; after a crash into the ground it is not judged any more, nor while nobody can steer."
    )
    topics = ("pose",)

    def __init__(self, facts: FlightFacts) -> None:
        super().__init__(facts)
        self._moments: list[TrueMoment] = []
        self._since_s: float | None = None
        self._worst = (0.0, 0.0)
        self._is_level = facts.platform.limits.survey_height_m == 0.0
        self._is_corrupted = facts.has_corrupted("pose")
        self._waiting: list[tuple[float, Pose]] = []
        self._has_crashed = False

    def observe(self, moment: TrueMoment) -> None:
        """Judges the poses since the moment before."""
        before = self._moments[-1] if self._moments else None
        self._has_crashed |= moment.is_on_ground and before is not None and before.velocity_ned_m_s[2] > CRASH_M_S
        self._moments.append(moment)
        if len(self._moments) > 10 * _HISTORY_S:
            self._moments.pop(0)
        waiting, self._waiting = self._waiting, []
        for t_s, pose in waiting:
            if t_s > moment.t_s:
                self._waiting.append((t_s, pose))
            elif before is not None:
                self._judge(t_s, pose)

    def receive(self, topic: str, envelope: Envelope[Any], now_s: float) -> None:
        """Keeps a pose until the truth of its time is known."""
        if not self._is_corrupted:
            self._waiting.append((envelope.t_s, envelope.payload))

    def _judge(self, t_s: float, pose: Pose) -> None:
        if not pose.is_valid or self._has_crashed or self.facts.is_out_of_control(t_s):
            self._since_s = None
            return
        found = self._truth_at(t_s)
        if found is None:
            return
        position_ned_m, is_under_way = found
        north, east, down = (a - b for a, b in zip(pose.position_ned_m, position_ned_m, strict=True))
        std = [max(LEAST_STD_M, value) for value in pose.position_std_m]
        level = hypot(north, east) / max(std[0], std[1])
        upright = 0.0 if self._is_level else abs(down) / std[2]
        if not is_under_way or max(level, upright) <= SIGMAS:
            self._since_s = None
            return
        self._since_s = t_s if self._since_s is None else self._since_s
        if t_s - self._since_s >= DISHONEST_S:
            off_m, claimed_m = (hypot(north, east), max(std[:2])) if level > upright else (abs(down), std[2])
            what = "beside" if level > upright else "above or below"
            self.break_at(
                t_s, f"valid and {off_m:.2f} m {what} the truth for {DISHONEST_S:g} s, claiming {claimed_m:.2f} m"
            )

    def _truth_at(self, t_s: float) -> tuple[tuple[float, float, float], bool] | None:
        """The true position at a time, between two moments."""
        for before, after in zip(self._moments[-2::-1], self._moments[:0:-1], strict=False):
            if before.t_s <= t_s <= after.t_s and after.t_s > before.t_s:
                share = (t_s - before.t_s) / (after.t_s - before.t_s)
                a, b = before.position_ned_m, after.position_ned_m
                n, e, d = (p + share * (q - p) for p, q in zip(a, b, strict=True))
                return (n, e, d), after.is_under_way
        return None


class DoneTrulyPassed(Invariant):
    """The waypoints of actions that are done against the true way."""

    name = "done_truly_passed"
    sentence = (
        "A way that is done has truly passed each of its waypoints in their order, as near as it was asked to and the "
        f"pose could tell ({SIGMAS:g} standard deviations)."
    )
    topics = ("action_status/*", "pose")

    def __init__(self, facts: FlightFacts) -> None:
        super().__init__(facts)
        self._truth: list[tuple[float, tuple[float, float, float]]] = []
        self._done: dict[str, float] = {}
        self._std_m: list[tuple[float, float]] = []
        """When it became what."""

    def observe(self, moment: TrueMoment) -> None:
        """Keeps the true way."""
        self._truth.append((moment.t_s, moment.position_ned_m))

    def receive(self, topic: str, envelope: Envelope[Any], now_s: float) -> None:
        """Keeps which actions are done, and how well the pose knew."""
        payload = envelope.payload
        if isinstance(payload, ActionStatus):
            if payload.state is ActionState.DONE:
                self._done.setdefault(payload.action_id, now_s)
        elif isinstance(payload, Pose) and payload.is_valid:
            std_m = max(payload.position_std_m)
            if not self._std_m or std_m != self._std_m[-1][1]:
                self._std_m.append((now_s, std_m))

    def end(self, flown: FlownMission) -> None:
        """Judges every way."""
        starts = [one.action_id for one in flown.requested]
        for way in flown.requested:
            end_s = self._done.get(way.action_id)
            if end_s is not None and starts.count(way.action_id) == 1 and not way.is_continued:
                self._judge(way, end_s)

    def _judge(self, way: RequestedFlight, end_s: float) -> None:
        limits = self.facts.platform.limits
        is_level = limits.survey_height_m == 0.0
        before_s = max((t_s for t_s, _ in self._std_m if t_s <= way.start_s - 5.0), default=-inf)
        std_m = max((std for t_s, std in self._std_m if before_s <= t_s <= end_s), default=0.0)
        near_m = max(PASSED_M, limits.survey_acceptance_m, way.acceptance_m, limits.turn_radius_m) + SIGMAS * std_m
        flown = [(t_s, position) for t_s, position in self._truth if way.start_s <= t_s <= end_s + 0.5]
        at = 0
        for number, wanted in enumerate(way.polyline_ned_m[1:], start=1):
            nearest_m, nearest_at = 1e9, at
            for index in range(at, len(flown)):
                position = flown[index][1]
                off_m = dist(position[:2], wanted[:2]) if is_level else dist(position, wanted)
                if off_m < nearest_m:
                    nearest_m, nearest_at = off_m, index
                if off_m <= near_m:
                    break
            if nearest_m > near_m:
                self.break_at(
                    end_s,
                    f"{way.action_id} is done, and passed waypoint {number} of {len(way.polyline_ned_m) - 1} at "
                    f"{nearest_m:.2f} m; {near_m:.2f} m counts as passed",
                )
                return
            at = nearest_at
