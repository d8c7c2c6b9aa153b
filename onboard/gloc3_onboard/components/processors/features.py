"""DP: features of the stereo pair, computed once for all users (FDM)."""

from collections.abc import Sequence
from typing import Annotated, Final

from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Keep, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.envelope import Envelope
from gloc3.messages.perception import Features, ImuSample
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.checks.frame_check import complaint
from gloc3_onboard.sensors.checks.silence import InputSilence
from gloc3_onboard.sensors.devices import Rig, calibrated

LONELY_S: Final = 0.2
"""Lateness of the other picture above which a picture counts as unpaired, s."""


class FeatureSettings(Settings, frozen=True):
    """Settings of the feature processor."""

    left: str = "front_left"
    """Name of the left camera, as it was calibrated."""
    right: str = "front_right"
    """Name of the right one."""
    cell_px: Annotated[int, Bounds(16, 200)] = 40
    """One feature in each square of this side, in pixels."""
    nearest_m: Annotated[float, Bounds(0.05, 100.0)] = 0.4
    """Nearest that anything is expected to be, in metres."""
    may_repeat: bool = False
    """Whether two pictures may be the same to the last bit; else the second is refused."""


class FeatureProcessor(DataProcessor[FeatureSettings]):
    """Reports the features of each pair of pictures that have the same time; invalid with a reason where there are none.

    With `inertial` bound to the topic of an inertial unit, its gyros tell where features are looked for in a turn.
    """

    loggable = ("pairs", "skipped", "refused", "points", "reason")

    left = Input(Image, Keep.ALL)
    right = Input(Image, Keep.ALL)
    inertial = Input(ImuSample, Keep.ALL, 512, is_optional=True)
    features = Output(Features)

    def __init__(self, rig: Rig) -> None:
        self.pairs = self.skipped = self.refused = self.points = 0
        self.reason = ""
        self._rig = rig
        self._lefts: dict[float, Envelope[Image]] = {}
        self._rights: dict[float, Envelope[Image]] = {}

    def initialize(self, settings: FeatureSettings) -> None:
        """Makes the matcher; refuses cameras that are not calibrated, or do not make a pair."""
        self.settings = settings
        self.start()

    def start(self) -> None:
        """Begins without a past."""
        from gloc3_onboard.algorithms.odometry.gyro_turn import GyroTurn
        from gloc3_onboard.algorithms.vision.feature_message import message_of
        from gloc3_onboard.algorithms.vision.features import FeatureMatcher, MatcherOptions
        from gloc3_onboard.algorithms.vision.picture import pixels_of
        from gloc3_onboard.algorithms.vision.stereo_rig import stereo_rig

        given = self.settings
        rig = stereo_rig(calibrated(self._rig, given.left), calibrated(self._rig, given.right))
        options = MatcherOptions(cell_px=given.cell_px, nearest_m=given.nearest_m, may_repeat=given.may_repeat)
        self._pixels_of, self._message_of = pixels_of, message_of
        self._gyro = GyroTurn()
        self._matcher = FeatureMatcher(rig, options, self._gyro)
        self._lefts, self._rights = {}, {}
        self._silence = InputSilence()

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Features of the newest pair; pairs that arrive too fast are skipped, not queued."""
        for sample in inbox.new(self.inertial):
            if sample.payload.is_valid:
                self._gyro.add(sample.t_s, sample.payload.rate_frd_rad_s)
        self._lefts |= {envelope.t_s: envelope for envelope in inbox.new(self.left)}
        self._rights |= {envelope.t_s: envelope for envelope in inbox.new(self.right)}
        both = sorted(self._lefts.keys() & self._rights.keys())
        if both:
            self._silence.end(now_s)
            t_s = both[-1]
            self.pairs += 1
            self.skipped += len(both) - 1
            found = self._check_pictures(self._lefts[t_s].payload, self._rights[t_s].payload, t_s)
            self._ignore_until(t_s)
            return [self._reported(found, t_s)]
        waiting = sorted(self._lefts.keys() | self._rights.keys())
        if waiting and waiting[-1] - waiting[0] > LONELY_S:
            name = self.settings.right if waiting[0] in self._lefts else self.settings.left
            self._ignore_until(waiting[0])
            return [self._reported(self._nothing(f"there is no picture of {name} at the same time"), waiting[0])]
        if not self._silence.is_due(now_s):
            return []
        return [self._reported(self._nothing("no pair of pictures received"), now_s)]

    def _ignore_until(self, t_s: float) -> None:
        self._lefts = {at_s: envelope for at_s, envelope in self._lefts.items() if at_s > t_s}
        self._rights = {at_s: envelope for at_s, envelope in self._rights.items() if at_s > t_s}

    def _check_pictures(self, left: Image, right: Image, t_s: float) -> Features:
        for image in (left, right):
            reason = complaint(image)
            if reason:
                return self._nothing(f"{image.camera}: {reason}")
        found = self._matcher.update(self._pixels_of(left), self._pixels_of(right), t_s)
        return self._message_of(found, self.settings.left)

    def _nothing(self, reason: str) -> Features:
        return Features(camera=self.settings.left, ids=b"", pixels=b"", is_valid=False, reason=reason)

    def _reported(self, found: Features, t_s: float) -> Result:
        self.reason, self.points = found.reason, len(found.ids) // 4
        self.refused += not found.is_valid
        return self.features.report(found, t_s=t_s)
