"""Checks that a depth picture is usable: whole, of the calibrated size, not the last one again."""

import math

import msgspec

from gloc3.camera.model import misfit
from gloc3.messages.perception import DepthImage
from gloc3_onboard.sensors.devices import Rig


class DepthCheck:
    """Checks the pictures of one depth camera.

    Args:
        rig: the calibrations; None where they are not known.
        may_repeat: whether two pictures may be the same to the last bit.
    """

    def __init__(self, rig: Rig | None, *, may_repeat: bool) -> None:
        self._rig, self._may_repeat = rig, may_repeat
        self._last = b""

    def marked(self, depth: DepthImage, problem: str) -> DepthImage:
        """The picture; not valid where it cannot be used, or for a problem that is known already.

        A picture without any depth is valid: so it is in the open. A camera that is covered, or closer to something than
        its least range, looks the same.
        """
        problem = problem or self._problem(depth)
        return msgspec.structs.replace(depth, is_valid=False, reason=problem) if problem else depth

    def _problem(self, depth: DepthImage) -> str:
        if problem := depth_fault(depth):
            return problem
        model = self._rig.model(depth.camera) if self._rig is not None else None
        if model is not None and (problem := misfit(model, depth.width, depth.height)):
            return problem
        is_same, self._last = depth.data == self._last, depth.data
        is_empty = not any(depth.data)
        return "the same picture again: the camera is stuck" if is_same and not (self._may_repeat or is_empty) else ""


def depth_fault(depth: DepthImage) -> str:
    """Why a depth picture cannot be used, by itself; empty if it can."""
    if not depth.is_valid:
        return depth.reason or "the camera reports it"
    if min(depth.width, depth.height) <= 0 or len(depth.data) != 2 * depth.width * depth.height:
        return f"torn: {len(depth.data)} bytes of a depth picture of {depth.width} x {depth.height}"
    if not (math.isfinite(depth.scale_m) and depth.scale_m > 0.0):
        return f"its unit of {depth.scale_m:g} m is impossible"
    if not 0.0 <= depth.range_min_m < depth.range_max_m < math.inf:
        return f"its ranges from {depth.range_min_m:g} to {depth.range_max_m:g} m are impossible"
    return ""


def no_depth(camera: str, reason: str) -> DepthImage:
    """What is reported where no picture comes."""
    return DepthImage(camera=camera, width=0, height=0, data=b"", is_valid=False, reason=reason)
