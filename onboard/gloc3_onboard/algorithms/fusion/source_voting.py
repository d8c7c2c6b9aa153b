"""Voting among the pose sources: their records, the outcome, and its consequences for the estimate."""

from collections import deque
from collections.abc import Callable, Sequence
from math import hypot, sqrt
from typing import Final

import numpy as np

from gloc3.messages.frames import Vector3
from gloc3_onboard.algorithms.fusion.error_state import Matrix
from gloc3_onboard.algorithms.fusion.estimate import PoseEstimate
from gloc3_onboard.algorithms.fusion.fault_isolation import FaultIsolation, IsolationResult, OtherAgreement
from gloc3_onboard.algorithms.fusion.lone_way import LoneWay
from gloc3_onboard.algorithms.fusion.odometers import Odometers
from gloc3_onboard.algorithms.fusion.settings import FusionSettings
from gloc3_onboard.algorithms.fusion.trust import DISAGREES, SOUND, Trust

HEIGHT: Final = "height"
VOTE_S: Final = 0.25
_STUCK_S: Final = 0.7
"""Time without an accepted measurement, while sources continue, after which the estimate counts as wrong, s."""
_ELSEWHERE_S: Final = (0.75, 1.5)
"""Time windows over which sources may agree on another position."""
_ALONE, _ALONE_OF_PLACES = 2.5, 1.75
"""Innovations of a single source beyond which it counts as wrong while all others are sound; lower for a source of
positions, which would pull the estimate permanently."""
_AGAIN_S: Final = 12.0
"""Where that comes again so soon, its biases were not the reason."""
_OFF_M: Final = 0.1
"""Possible error of the estimate that a source of positions may correct."""
_LOST_S: Final = 2.0
"""A pose that is lost is doubted so often."""
_FALLEN_M: Final = 0.3
"""Possible error of the height once nothing that measures it passes."""
LEADING_M: Final = 0.05
"""Heights that fail the gate and have led away from the floor by more contradict the estimate;"""
_FLOOR_M: Final = 0.1
"""and by more than that, that of the estimate alone, which moves: another floor stays as far from the one before."""
_TOGETHER_S: Final = 1.0
"""Sources that begin to fail within that have not each failed by themselves."""
_LONE: Final = 2.0
"""An odometer that is left alone may be wrong by so many times the error of scale with which it would still agree with others."""
_SEEN_M2: Final = 0.05**2
"""Along an axis that a source of positions knows better, it shows the error of an odometer's scale."""
_LASTING, _LASTING_M = 0.8, 0.05
"""A separation of the sources that lasts for that share of their window, and is greater, is not over when the window is."""
_SUDDEN_S, _SUDDEN_M = 1.0, 0.25
"""A source that becomes plainly wrong, or is far off, is for so long a doubt of the estimate of no more than so much."""
_ARGUED_S: Final = 3.0
"""Where sources contradict each other for longer, the vehicle had better hold."""


class SourceVoting:
    """Keeps the record of every source and runs the vote.

    Args:
        estimate: corrected by the sources.
        odometers: their references.
        settings: of the fusion.
        distrust_imu: called with the time and reason when the inertial unit contradicts all others.
    """

    def __init__(
        self,
        estimate: PoseEstimate,
        odometers: Odometers,
        settings: FusionSettings,
        distrust_imu: Callable[[float, str], None],
    ) -> None:
        self.trust: Final[dict[str, Trust]] = {}
        self.isolation: Final = FaultIsolation(settings.window_s, settings.odometer_scale_std, estimate.alone)
        self.held_s = float("-inf")
        """When a source last held the position."""
        self.conflict: IsolationResult | None = None
        """Two sources that contradict each other, with no third one to decide."""
        self.conflict_s = float("-inf")
        """Since when, with interruptions that are shorter than the window in which they agree again."""
        self._contradicted_s, self._contradicted = float("-inf"), tuple[str, ...]()
        self.height_drift_m = 0.0
        """By how much heights that fail the gate, one after the other, have moved away since the first of them."""
        self.is_standing = False
        """The body has not moved since it was aligned."""
        self._estimate, self._odometers, self._settings = estimate, odometers, settings
        self._distrust_imu = distrust_imu
        self._unconfirmed: set[str] = set()
        """Sources that were voted out by one other and the inertial unit."""
        self._kept_out: set[str] = set()
        """Sources that the inertial unit has kept from being used again."""
        self._convicted: set[str] = set()
        """Sources that were voted out, or moved unfelt by the inertial unit, and have not been used again since."""
        self._returned: set[str] = set()
        """Sources of positions that are used again after they were turned down."""
        self._doubtful_s = float("-inf")
        """When the position was last held by no two sources of positions of which one has always been right."""
        self._lone: LoneWay | None = None
        """The way that only one odometer has held."""
        self._near_s = float("-inf")
        """When no source was far off."""
        self._lasting = round(_LASTING * settings.window_s / VOTE_S)
        self._separations_m: deque[Vector3] = deque(maxlen=self._lasting)
        """Of the sources that are used, in the last votes."""
        self._voted_s = float("-inf")
        self._distrusted_s = float("-inf")
        """When the estimate's motion was last doubted."""

    def received(self, source: str, now_s: float) -> Trust:
        """Notes a message of a source; returns the source's record."""
        trust = self.trust.get(source)
        if trust is None:
            trust = self.trust[source] = Trust(source, self._settings.probation_s)
        trust.received_s = now_s
        return trust

    def hold(self, t_s: float) -> None:
        """Notes that a source held the position at a time."""
        self.held_s = max(self.held_s, t_s)

    def check_silence(self, now_s: float) -> None:
        """Stops using sources that are silent."""
        for trust in self.trust.values():
            if now_s - trust.received_s > self._settings.silent_s:
                trust.step_back("nothing comes from it")

    def update(self) -> None:
        """Runs the vote a few times a second."""
        now_s = self._estimate.t_s
        if now_s - self._voted_s >= VOTE_S - 1e-6:
            self._voted_s = now_s
            self._estimate.remember_motion()
            self._vote(now_s)

    # --- what it has found ---

    @property
    def witnesses(self) -> list[str]:
        """The sources that hold the horizontal position now."""
        limit_s = self._estimate.t_s - self._settings.silent_s
        return [
            name for name in self.isolation.records if self.trust[name].is_used and self.trust[name].used_s > limit_s
        ]

    @property
    def quality(self) -> float:
        """1 where several sources agree, 0.8 with two, 0.5 with one, 0.2 with none; less as it becomes uncertain."""
        quality = 1.0 if self.is_standing else (0.2, 0.5, 0.8, 1.0)[min(len(self.witnesses), 3)]
        if self.conflict is not None:
            quality = min(quality, 0.25 if self.argued_s > _ARGUED_S else 0.5)
        north, east, down = self._estimate.position_std_m
        return quality * max(0.0, 1.0 - (max(north, east, down) / self._settings.std_limit_m) ** 2)

    @property
    def argued_s(self) -> float:
        """How long two sources have contradicted each other while nothing else holds the position; 0 while something does."""
        if self.conflict is None or any(
            self.isolation.records[name].is_of_places and name not in self.conflict.against for name in self.witnesses
        ):
            return 0.0
        return self._estimate.t_s - self.conflict_s

    def problems(self) -> str:
        """The faults of all sources, in words."""
        reported = [f"{name}: {trust.reason}" for name, trust in self.trust.items() if trust.reason]
        if self.conflict is not None:
            reported.append(f"{' and '.join(self.conflict.against)} contradict each other")
        return "; ".join(reported) or "no source"

    @property
    def is_disputed(self) -> bool:
        """Whether two or more sources disagree with the estimate, which may be wrong itself."""
        return sum(self.trust[name].reason == DISAGREES for name in self.isolation.records) > 1

    # --- the vote ---

    def _vote(self, now_s: float) -> None:
        voters = {name: self.trust[name].may_vote for name in sorted(self.isolation.records)}
        position = self._estimate.inertial.now.position_ned_m
        verdict = self.isolation.update(voters, position, self._estimate.heading_std_rad, now_s)
        if self.isolation.witness.is_doubted(now_s):
            self._acquit()
        if verdict.voted_out:
            self._vote_out(verdict)
        is_settled = verdict.is_unanimous or bool(verdict.voted_out)
        if not is_settled:  # who was plainly wrong is not believed to be right
            is_settled = any(self.trust[name].is_coarse and not self.trust[name].is_used for name in verdict.against)
        if is_settled:
            verdict = self._contradiction(now_s)
        self._follow_conflict(None if verdict.is_unanimous else verdict, now_s)
        for name in self.isolation.witness.clearly_against:  # its gate alone does not let it in again
            if not self.trust[name].is_used:
                self.trust[name].is_voted_out = True
                self._kept_out.add(name)
                self._convicted.add(name)
        used = [name for name, may in voters.items() if may and self.trust[name].is_used]
        for name in voters:
            trust = self.trust[name]
            if trust.is_voted_out and self.isolation.agrees(name, [other for other in used if other != name], now_s):
                trust.is_voted_out = False  # its gate and the probation are left
        self._check_single_source(now_s)
        self._check_vertical(now_s)
        self._check_stuck(now_s)
        self._separate(now_s)
        self._confirm_reference(now_s)
        self._claim_scale()
        self._estimate.misfit = self._misfit()

    def _misfit(self) -> float:
        """Mean smoothed innovation of the sources that are used where it is more than sound, as a factor; else 1."""
        # Sources that contradict what they have made together: its variance times their chi-square (Birge 1932).
        trusts = [self.trust[name] for name in (*self.isolation.records, HEIGHT) if name in self.trust]
        used = [trust.innovation for trust in trusts if trust.is_used]
        return max(sum(used) / max(len(used), 1) / SOUND, 1.0)

    def _acquit(self) -> None:
        """Uses again all that were voted out on the word of the inertial unit, which is wrong itself."""
        accused = self._unconfirmed | self._kept_out
        for name in sorted(accused):
            if self.trust[name].is_voted_out:
                self._odometers.reset(name)
                self.trust[name].let_in()
        self._convicted -= accused
        self._unconfirmed.clear()
        self._kept_out.clear()

    def has_been_wrong(self, source: str) -> bool:
        """Whether a source has not been used since others or the inertial unit have found it wrong."""
        return source in self._convicted

    def returned(self, source: str, apart_m: Matrix, std_m: Vector3) -> None:
        """Notes that a source of positions is used again after it was turned down.

        Args:
            source: its name.
            apart_m: how far the position was from it, (3,) in NED.
            std_m: standard deviation of the position before.
        """
        self._convicted.discard(source)
        self._returned.add(source)
        self._doubtful_s = self._estimate.t_s
        self._estimate.doubt_reference(apart_m, std_m)

    def _confirm_reference(self, now_s: float) -> None:
        """Ends the doubt about the reference once another source of positions, never turned down, holds it as well."""
        holding = {name for name, record in self.isolation.records.items() if record.is_of_places}
        holding = {name for name in holding if self.trust[name].is_used}
        if len(holding) < 2 or holding <= self._returned or self.conflict is not None:
            self._doubtful_s = now_s
        elif now_s - self._doubtful_s > self._settings.window_s:
            self._estimate.reference_m = (0.0, 0.0, 0.0)

    def _contradiction(self, now_s: float) -> IsolationResult:
        """The contradiction of the only source that is left with one that was voted out, but not by two others."""
        used = [name for name in self.isolation.records if self.trust[name].is_used]
        excluded = [name for name in sorted(self._unconfirmed) if self.trust[name].is_voted_out]
        return self.isolation.contradiction(excluded, used[0], now_s) if len(used) == 1 else IsolationResult()

    def _separate(self, now_s: float) -> None:
        """Doubts the position at once where any source, used or perhaps rightly against the estimate, is elsewhere.

        Some reports in a row with the same error are not known from a drift for a moment: meanwhile the doubt is limited.
        """
        records = self.isolation.records
        doubted = [name for name in sorted(records) if self._may_be_right(self.trust[name], now_s)]
        is_held = any(records[name].is_of_places and self.trust[name].is_used for name in doubted)
        is_faulty = any(self.trust[name].is_turned_down for name in records)
        apart_m = self.isolation.separation(doubted, now_s, is_strict=is_faulty and not is_held)
        if max(apart_m) <= _SUDDEN_M:
            self._near_s = now_s
        north, east, down = np.minimum(apart_m, _SUDDEN_M).tolist()
        self._estimate.separation_m = (north, east, down) if now_s - self._near_s < _SUDDEN_S else apart_m
        used = [name for name in doubted if self.trust[name].is_used]
        self._doubt_lasting(apart_m if used == doubted else self.isolation.separation(used, now_s), is_held=is_held)

    def _doubt_lasting(self, apart_m: Vector3, *, is_held: bool) -> None:
        """Doubts the reference where the sources that are used have been apart until the begin of that is forgotten.

        It has moved, or has not and they have: nobody can tell any more.
        """
        self._separations_m.append(apart_m)
        lasting_m = np.min(self._separations_m, axis=0)
        if len(self._separations_m) < self._lasting or lasting_m.max() <= _LASTING_M:
            return
        north, east, down = lasting_m.tolist()
        if is_held:
            self._estimate.doubt_reference(np.zeros(3), (north, east, down))
        elif HEIGHT in self.trust and self.trust[HEIGHT].is_used:
            self._estimate.doubt_reference(np.zeros(3), (0.0, 0.0, down))

    def doubt_gap(self, source: str) -> None:
        """Doubts the position by what an odometer that comes back has reported else while nothing held the position."""
        record, now_s = self.isolation.records.get(source), self._estimate.t_s
        if record is not None and now_s - self.held_s > VOTE_S and record.is_about(self.held_s, now_s):
            north, east, down = record.over(self.held_s)[0]
            self._estimate.inflate_position((north, east, down))

    def _claim_scale(self) -> None:
        """Claims an error of scale for the way of an odometer that is left alone: nothing shows it any more.

        A source of positions shows it, but along a line of sight that it hardly knows: as far as that, the error is told only.
        """
        estimate, records, holding = self._estimate, self.isolation.records, self.witnesses
        places = [name for name in holding if records[name].is_of_places]
        if len(holding) - len(places) != 1 or len(records) < 2:
            if max(estimate.scale_m) > _LASTING_M:
                estimate.doubt_reference(np.zeros(3), estimate.scale_m)
            self._lone, estimate.scale_m = None, (0.0, 0.0, 0.0)
            return
        place = estimate.inertial.now.position_ned_m
        if self._lone is None:
            self._lone = LoneWay(place)
        more_m = self._lone.grow(place, _LONE * self._settings.odometer_scale_std)
        if places:
            known_m2 = np.min([records[name].covariance.diagonal() for name in places], axis=0)
            reported_m2 = np.minimum(np.square(estimate.scale_m) + np.square(more_m), known_m2)
            north, east, down = np.sqrt(np.where(known_m2 < _SEEN_M2, 0.0, reported_m2)).tolist()
            estimate.scale_m = (north, east, down)
        else:
            estimate.inflate_position(more_m)

    @staticmethod
    def _may_be_right(trust: Trust, now_s: float) -> bool:
        """Whether it is used, or is not because of an estimate that may be wrong.

        One that has become plainly wrong tells as much for a moment: so it looks as well where the estimate runs away.
        """
        return trust.is_used or (trust.may_vote and (not trust.is_coarse or now_s - trust.down_s < _SUDDEN_S))

    def _follow_conflict(self, conflict: IsolationResult | None, now_s: float) -> None:
        """Follows an undecided conflict: the pose may drift as fast as the two sources diverge, and stays off.

        Meanwhile the possible error is only reported: given to the filter, all of it would be attributed to a source of
        positions, even if that is the wrong one. The filter gets it if both are still used at the end, or one was outvoted;
        else it is cleared when all are used again. One so long that the pose was not valid leaves its error with the
        reference, whoever agrees with whom afterwards.
        """
        estimate = self._estimate
        (x, y, z) = estimate.disputed_m
        if conflict is not None:
            dx, dy, dz = map(abs, conflict.apart_m)
            if now_s - self._contradicted_s > self._settings.window_s:
                self.conflict_s = now_s
                estimate.disputed_m = (max(x, dx), max(y, dy), max(z, dz))
            else:
                share = VOTE_S / (0.5 * self._settings.window_s)
                estimate.disputed_m = (x + dx * share, y + dy * share, z + dz * share)
            self._contradicted_s, self._contradicted = now_s, conflict.against
        elif now_s - self._contradicted_s > self._settings.window_s:
            if self._contradicted and self._contradicted_s - self.conflict_s > self._settings.dispute_s:
                estimate.doubt_reference(np.zeros(3), estimate.disputed_m)
            if self._contradicted and all(
                self.trust[name].is_used or self._is_outvoted(name) for name in self._contradicted
            ):
                estimate.inflate_position(estimate.disputed_m)
                estimate.disputed_m = (0.0, 0.0, 0.0)
            self._contradicted = ()
            if all(self.trust[name].is_used for name in self.isolation.records):
                estimate.disputed_m = (0.0, 0.0, 0.0)
        self.conflict = conflict

    def _is_outvoted(self, source: str) -> bool:
        """Whether it was voted out, not by the inertial unit and one other alone, and two at least hold the position."""
        return self.trust[source].is_voted_out and source not in self._unconfirmed and len(self.witnesses) > 1

    def _vote_out(self, verdict: IsolationResult) -> None:
        """Applies a verdict: inflates what the culprit has moved, and readmits the sources that it made look bad."""
        # Exclude the culprit, inflate by what it pulled, readmit the sources it contradicted.
        apart = hypot(*verdict.apart_m)
        others = " and ".join(verdict.against)
        if verdict.voted_out in self.isolation.witness.against:
            others += ", and the inertial unit has not felt it"
        culprit = self.trust[verdict.voted_out]
        if culprit.is_used and not self.doubt_drag(verdict.voted_out):
            self._estimate.inflate_position(verdict.apart_m)
        if len(verdict.against) > 1:
            self._unconfirmed.discard(verdict.voted_out)
            self._kept_out.discard(verdict.voted_out)
        else:
            self._unconfirmed.add(verdict.voted_out)
        self._convicted.add(verdict.voted_out)
        culprit.turn_down(f"voted out: {apart:.2f} m from {others}", is_voted_out=True)
        self._odometers.reset(verdict.voted_out)
        for name in verdict.against:
            if not self.trust[name].is_used:
                self._odometers.reset(name)
                self.trust[name].let_in()

    def doubt_drag(self, source: str) -> bool:
        """Doubts the position by as much as one that is not used any more has moved it away from the others."""
        others = [name for name in sorted(self.isolation.records) if name != source and self.trust[name].is_used]
        dragged = self.isolation.dragged(others, self._estimate.t_s)
        if dragged is not None:
            self._estimate.doubt_drag(dragged, self._estimate.t_s - self._settings.window_s)
        return dragged is not None

    def _check_stuck(self, now_s: float) -> None:
        """When odometers that agree do not pass any more, the estimate is wrong: its biases, or the inertial unit itself."""
        going_on = [name for name in self.isolation.records if self.trust[name].may_vote and not self._is_silent(name)]
        if going_on and now_s - self.held_s > self._settings.coast_s and now_s - self._distrusted_s >= _LOST_S:
            # The pose is lost. Whoever goes on and agrees with himself may find it again, after his probation.
            self._distrusted_s = now_s
            self._estimate.inflate_motion()
            return
        if len(going_on) < 2 or self.conflict is not None:
            return
        # Agreement against the estimate: move it there; a second time within 12 s the IMU is at fault.
        found = self._elsewhere(going_on, now_s)
        if found is not None:
            if now_s - self._distrusted_s < _AGAIN_S:
                self._distrust_imu(now_s, f"it contradicts {' and '.join(found.names)}")
            self._estimate.move_over(found.by_m, found.covariance)
            self.distrust(found.names, now_s)
        elif now_s - self.held_s >= _STUCK_S:
            self.distrust(going_on, now_s)

    def _check_vertical(self, now_s: float) -> None:
        """When all that measure vertical motion do not pass any more, the estimate's is wrong, whoever holds the place."""
        records, since_s = self.isolation.records, now_s - self._distrusted_s
        judges = self._vertical_judges()
        is_leading = self.height_drift_m > (LEADING_M if judges else _FLOOR_M)
        if self._may_judge(HEIGHT) and (is_leading or self._have_failed_together([HEIGHT, *judges])):
            judges.append(HEIGHT)
        is_judged = len(judges) > 1 or judges == [HEIGHT]
        if since_s < _LOST_S or not is_judged or not all(self.trust[name].is_failing for name in judges):
            return
        if since_s < _AGAIN_S:
            self._distrust_imu(now_s, f"it contradicts {' and '.join(judges)}")
        self.distrust([name for name in judges if name in records], now_s)
        self._estimate.inflate_position((0.0, 0.0, _FALLEN_M))
        if is_leading and HEIGHT in judges:
            self.trust[HEIGHT].let_in()

    def _may_judge(self, source: str) -> bool:
        """Whether a source reports and is believed, or is not because it contradicts an estimate that may be wrong."""
        return source in self.trust and self.trust[source].may_vote and not self._is_silent(source)

    def _have_failed_together(self, names: list[str]) -> bool:
        """Whether two sources or more have begun to fail within a second: the estimate has left them, and not one of them it."""
        times = [self.trust[name].missed_s for name in names]
        return len(names) > 1 and max(times) - min(times) < _TOGETHER_S

    @property
    def is_height_held(self) -> bool:
        """Whether a source that measures vertical motion passes."""
        judges = [self.trust[name] for name in self._vertical_judges()]
        return any(trust.is_used and not trust.is_failing for trust in judges)

    def _vertical_judges(self) -> list[str]:
        """The sources that measure vertical motion and may judge; the heights are not among them."""
        records = self.isolation.records
        return [name for name in records if records[name].sees_vertical and self._may_judge(name)]

    def distrust(self, names: Sequence[str], now_s: float) -> None:
        """Inflates the estimate's motion and readmits these sources."""
        self._distrusted_s = now_s
        self._estimate.inflate_motion()
        if any(self.isolation.records[name].is_of_places for name in names):
            self._estimate.inflate_position((_OFF_M, _OFF_M, _OFF_M))
        for name in names:  # what a source tells that does agree, from where it began, keeps the heading
            if self._is_off(self.trust[name]):
                self._odometers.reset(name)
                self.trust[name].let_in()

    def _elsewhere(self, names: list[str], now_s: float) -> OtherAgreement | None:
        """Agreement of sources against the estimate, of which at least two are not accepted now."""
        off = {name for name in names if self._is_off(self.trust[name])}
        for length_s in _ELSEWHERE_S if len(off) > 1 else ():
            begin_s = now_s - length_s
            found = self.isolation.elsewhere(names, begin_s, now_s) if begin_s > self._distrusted_s else None
            if found is not None and len(off.intersection(found.names)) > 1:
                return found
        return None

    @staticmethod
    def _is_off(trust: Trust) -> bool:
        return trust.innovation > SOUND or not trust.is_used

    def _check_single_source(self, now_s: float) -> None:
        """Who is off by more than he claims for some time, where two others at least are not, is not used."""
        limit_s = now_s - self._settings.silent_s
        used = [trust for trust in (self.trust[name] for name in self.isolation.records) if trust.is_used]
        used = [trust for trust in used if trust.used_s > limit_s]
        # Single fault: one smoothed innovation beyond its limit while those of all others are sound.
        worst = max(used, key=lambda trust: trust.innovation, default=None)
        if worst is None or len(used) < 3:
            return
        if worst.innovation < (_ALONE_OF_PLACES if self.isolation.records[worst.name].is_of_places else _ALONE):
            return
        if any(trust.innovation > SOUND for trust in used if trust is not worst):
            return
        unfelt = self.isolation.witness.against
        if worst.name not in unfelt and any(trust.name in unfelt for trust in used):
            return
        self.doubt_drag(worst.name)
        worst.turn_down(f"it alone is {sqrt(worst.innovation):.1f} times as far off as it claims", is_alone=True)
        self._odometers.reset(worst.name)

    def _is_silent(self, source: str) -> bool:
        return self._estimate.t_s - self.trust[source].valid_s > self._settings.silent_s
