"""A pose fusion that keeps, for those who judge it, what it believed and how sure of it it was."""

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from gloc3.component.ports import Inbox, Result
from gloc3.messages.frames import Quaternion, Vector3
from gloc3.platform.reader import whole_text
from gloc3_onboard.components.processors.pose_fusion import PoseFusionProcessor

Array = np.ndarray[Any, np.dtype[Any]]
_ROWS = [0, 1, 2, 6, 7, 8]
_CLASS = "gloc3_onboard.components.processors.pose_fusion:PoseFusionProcessor"


class Belief(NamedTuple):
    """A pose as it was believed."""

    t_s: float
    reported_ned_m: Vector3
    position_ned_m: Vector3
    """Without what is still to be blended in."""
    ned_from_frd: Quaternion
    covariance: Array
    """(6, 6): of position and rotation vector, in NED."""
    is_valid: bool


class ProbedFusion(PoseFusionProcessor):
    """As its base does, with a diary."""

    made: ClassVar[list["ProbedFusion"]] = []
    """In the order of the platform's rows; whoever flies clears it first."""

    def __init__(self) -> None:
        super().__init__()
        self.made.append(self)
        self.beliefs: list[Belief] = []
        self.innovations: dict[str, list[tuple[float, float, int]]] = {}
        """By source: time, normalised square, degrees of freedom."""

    def start(self) -> None:
        super().start()
        assert self._fusion is not None
        self._fusion.on_innovation = self._note

    def _note(self, source: str, square: float, degrees: int) -> None:
        assert self._fusion is not None
        self.innovations.setdefault(source, []).append((self._fusion.estimate.t_s, square, degrees))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        results = super().work(now_s, inbox)
        fusion = self._fusion
        if fusion is not None and fusion.is_aligned:
            estimate = fusion.estimate
            estimate.predict()
            now = estimate.inertial.now
            covariance = estimate.errors.covariance[np.ix_(_ROWS, _ROWS)].copy()
            self.beliefs.append(
                Belief(
                    now.t_s,
                    estimate.reported_ned_m,
                    now.position_ned_m,
                    now.ned_from_frd,
                    covariance,
                    is_valid=not fusion.why_not_valid(),
                )
            )
        return results


def probed(platform: str) -> str:
    """A platform's file with the probe in place of its fusion; the standby, which is quiet, does without the tracker."""
    lines = whole_text(platform).replace(_CLASS, "tests.flight.probe:ProbedFusion").splitlines()
    tracker = "position_fix: [position_fix/tracker]"
    at = next(number for number, line in enumerate(lines) if "name: pose_standby," in line)
    assert tracker in lines[at]
    lines[at] = lines[at].replace(tracker, "position_fix: []")
    return "\n".join(lines) + "\n"
