"""The jury over the sources: their records, their vote, and what follows from it for the estimate."""

from collections.abc import Callable
from itertools import pairwise
from math import hypot, sqrt
from typing import Final

from gloc3.frames import Vector3
from gloc3_onboard.fusion.estimate import Estimate
from gloc3_onboard.fusion.odometers import Odometers
from gloc3_onboard.fusion.settings import FusionSettings
from gloc3_onboard.fusion.trust import DISAGREES, SOUND, Trust
from gloc3_onboard.fusion.vote import Verdict, Vote

VOTE_S: Final = 0.25
_STUCK_S: Final = 0.7
"""When nothing was taken in for so long while sources go on, it is the estimate that is wrong."""
_FAR_OFF: Final = 4.0
"""Where the innovations of all odometers are beyond that, and they agree with each other, the estimate is wrong."""
_AT_ONCE_S: Final = 0.3
_ALONE: Final = 2.5
"""Where the innovations of one source alone are beyond that, and all others are sound, it is that source that is wrong."""
_AGAIN_S: Final = 4.0
"""Where that comes again so soon, its biases were not the reason."""
_LOST_S: Final = 2.0
"""A pose that is lost is doubted so often."""
_ARGUED_S: Final = 3.0
"""Where sources contradict each other for longer, the vehicle had better hold."""


class Jury:
    """Keeps what is known of every source, and takes the vote.

    Args:
        estimate: what the sources correct.
        odometers: their references.
        settings: of the fusion.
        doubt_imu: told the time and why, when the inertial unit is what contradicts all others.
    """

    def __init__(
        self,
        estimate: Estimate,
        odometers: Odometers,
        settings: FusionSettings,
        doubt_imu: Callable[[float, str], None],
    ) -> None:
        self.trust: Final[dict[str, Trust]] = {}
        self.vote: Final = Vote(settings.window_s, settings.odometer_scale_std)
        self.held_s = float("-inf")
        """When a source last held the position."""
        self.conflict: Verdict | None = None
        """Two that contradict each other, with nobody to tell who is right."""
        self.conflict_s = float("-inf")
        """Since when."""
        self.is_standing = False
        """The body has not moved since it was aligned."""
        self._estimate, self._odometers, self._settings, self._doubt_imu = estimate, odometers, settings, doubt_imu
        self._voted_s = float("-inf")
        self._disputed_m: Vector3 = (0.0, 0.0, 0.0)
        """How far off the pose may be by the conflict so far."""
        self._doubted_s = float("-inf")
        """When the estimate's motion was last doubted."""

    def heard(self, source: str, now_s: float) -> Trust:
        """The record of a source that has just said something."""
        trust = self.trust.get(source)
        if trust is None:
            trust = self.trust[source] = Trust(source, self._settings.probation_s)
        trust.heard_s = now_s
        return trust

    def hold(self, t_s: float) -> None:
        """A source has held the position at a time."""
        self.held_s = max(self.held_s, t_s)

    def look_for_silence(self, now_s: float) -> None:
        """Who says nothing any more is not used."""
        for trust in self.trust.values():
            if now_s - trust.heard_s > self._settings.silent_s:
                trust.step_back("nothing comes from it")

    def look(self) -> None:
        """Takes the vote, some times a second."""
        now_s = self._estimate.t_s
        if now_s - self._voted_s >= VOTE_S - 1e-6:
            self._voted_s = now_s
            self._take_vote(now_s)

    # --- what it has found ---

    @property
    def witnesses(self) -> list[str]:
        """The sources that hold the horizontal position now."""
        limit_s = self._estimate.t_s - self._settings.silent_s
        return [name for name in self.vote.records if self.trust[name].is_used and self.trust[name].used_s > limit_s]

    @property
    def quality(self) -> float:
        """1 where several sources agree, 0.8 with two, 0.5 with one, 0.2 with none; less as it becomes uncertain."""
        quality = 1.0 if self.is_standing else (0.2, 0.5, 0.8, 1.0)[min(len(self.witnesses), 3)]
        if self.conflict is not None:
            quality = min(quality, 0.5 if self._estimate.t_s - self.conflict_s < _ARGUED_S else 0.25)
        north, east, down = self._estimate.position_std_m
        return quality * max(0.0, 1.0 - (max(north, east, down) / self._settings.std_limit_m) ** 2)

    def troubles(self) -> str:
        """What is wrong with whom, in words."""
        told = [f"{name}: {trust.reason}" for name, trust in self.trust.items() if trust.reason]
        if self.conflict is not None:
            told.append(f"{' and '.join(self.conflict.against)} contradict each other")
        return "; ".join(told) or "no source"

    @property
    def is_disputed(self) -> bool:
        """Whether two sources or more do not agree with the estimate: it may be what is wrong."""
        return sum(self.trust[name].reason == DISAGREES for name in self.vote.records) > 1

    # --- the vote ---

    def _take_vote(self, now_s: float) -> None:
        voters = {name: self.trust[name].may_vote for name in sorted(self.vote.records)}
        position = self._estimate.inertial.now.position_ned_m
        verdict = self.vote.look(voters, position, self._estimate.heading_std_rad, now_s)
        if verdict.voted_out:
            self._vote_out(verdict)
        is_settled = verdict.is_unanimous or bool(verdict.voted_out)
        if not is_settled:  # who was plainly wrong is not believed to be right
            is_settled = any(self.trust[name].is_coarse and not self.trust[name].is_used for name in verdict.against)
        self._follow_conflict(None if is_settled else verdict, now_s)
        used = [name for name, may in voters.items() if may and self.trust[name].is_used]
        for name in voters:
            trust = self.trust[name]
            if trust.is_voted_out and self.vote.agrees(name, [other for other in used if other != name], now_s):
                trust.is_voted_out = False  # its gate and the probation are left
        self._look_for_one_alone(now_s)
        self._look_whether_stuck(now_s)

    def _follow_conflict(self, conflict: Verdict | None, now_s: float) -> None:
        """While nobody can tell who is right, the pose may go off as fast as the two go apart, and stays so."""
        if conflict is not None:
            is_new = self.conflict is None
            if is_new:
                self.conflict_s, self._disputed_m = now_s, (0.0, 0.0, 0.0)
            share = 1.0 if is_new else VOTE_S / (0.5 * self._settings.window_s)
            (x, y, z), (dx, dy, dz) = self._disputed_m, conflict.apart_m
            more = (abs(dx) * share, abs(dy) * share, abs(dz) * share)
            self._disputed_m = (x + more[0], y + more[1], z + more[2])
            north, east, down = (sqrt(a * a - b * b) for a, b in zip(self._disputed_m, (x, y, z), strict=True))
            self._estimate.doubt_place((north, east, down))
        self.conflict = conflict

    def _vote_out(self, verdict: Verdict) -> None:
        """Takes the word of the others: what the culprit has moved may be off, and whom it made look bad is let in."""
        apart = hypot(*verdict.apart_m)
        others = " and ".join(verdict.against)
        culprit = self.trust[verdict.voted_out]
        if culprit.is_used:
            pulled = self.vote.record(verdict.voted_out).pulled_m
            self._estimate.doubt_place(verdict.apart_m if pulled is None else pulled)
        culprit.turn_down(f"voted out: {apart:.2f} m from {others}", is_voted_out=True)
        self._odometers.forget(verdict.voted_out)
        for name in verdict.against:
            if not self.trust[name].is_used:
                self._odometers.forget(name)
                self.trust[name].let_in()

    def _look_whether_stuck(self, now_s: float) -> None:
        """When odometers that agree do not pass any more, the estimate is wrong: its biases, or the inertial unit itself."""
        going_on = [name for name in self.vote.records if self.trust[name].may_vote and not self._is_silent(name)]
        if going_on and now_s - self.held_s > self._settings.coast_s and now_s - self._doubted_s >= _LOST_S:
            # The pose is lost. Whoever goes on and agrees with himself may find it again, after his probation.
            self._doubted_s = now_s
            self._estimate.doubt_motion()
            return
        if len(going_on) < 2 or self.conflict is not None:
            return
        is_far_off = self._is_beside(going_on)
        if now_s - self.held_s < _STUCK_S and not is_far_off:
            return
        if is_far_off and now_s - self._doubted_s < _AGAIN_S:
            self._doubt_imu(now_s, f"it contradicts {' and '.join(going_on)}")
        self._doubted_s = now_s
        self._estimate.doubt_motion()
        for name in going_on:
            self._odometers.forget(name)
            self.trust[name].let_in()

    def _is_beside(self, going_on: list[str]) -> bool:
        """Whether the sources say that the estimate is elsewhere: all odometers, or half of all, two of them at the same time.

        One that is blind to that, as a laser scanner is to the height, does not say it.
        """
        trusts = [self.trust[name] for name in going_on]
        motions = [self.trust[name] for name in going_on if not self.vote.records[name].is_of_places]
        if len(motions) > 1 and all(self._is_off(trust) for trust in motions):
            return True
        off = [trust for trust in trusts if self._is_off(trust)]
        times_s = sorted(trust.down_s for trust in off if not trust.is_used)
        is_at_once = any(b - a < _AT_ONCE_S for a, b in pairwise(times_s))
        return is_at_once and 2 * len(off) >= len(going_on)

    def _is_off(self, trust: Trust) -> bool:
        return trust.innovation > _FAR_OFF or not trust.is_used

    def _look_for_one_alone(self, now_s: float) -> None:
        """Who is off by more than he claims for some time, where two others at least are not, is not used."""
        limit_s = now_s - self._settings.silent_s
        used = [trust for trust in (self.trust[name] for name in self.vote.records) if trust.is_used]
        used = [trust for trust in used if trust.used_s > limit_s]
        worst = max(used, key=lambda trust: trust.innovation, default=None)
        if worst is None or len(used) < 3 or worst.innovation < _ALONE:
            return
        if any(trust.innovation > SOUND for trust in used if trust is not worst):
            return
        pulled = self.vote.record(worst.name).pulled_m
        if pulled is not None:
            self._estimate.doubt_place(pulled)
        worst.turn_down(f"it alone is {sqrt(worst.innovation):.1f} times as far off as it claims", is_alone=True)
        self._odometers.forget(worst.name)

    def _is_silent(self, source: str) -> bool:
        return self._estimate.t_s - self.trust[source].valid_s > self._settings.silent_s
