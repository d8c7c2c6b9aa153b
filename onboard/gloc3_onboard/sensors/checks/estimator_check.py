"""The next pose of an estimator that is not ours: each once, marked where its time cannot be believed, or nothing comes."""

from gloc3.messages.perception import EstimatorPose
from gloc3_onboard.sensors.checks.timeline import StampMonitor
from gloc3_onboard.sensors.devices import ExternalEstimator, StampedEstimatorPose


def next_pose(device: ExternalEstimator, timeline: StampMonitor, now_s: float) -> StampedEstimatorPose | None:
    """The pose that has not been reported yet, or once per silence one that is not valid; None for neither."""
    stamped = device.estimated_pose()
    arrival = timeline.judge(stamped.t_s, now_s) if stamped is not None else None
    if stamped is None or arrival is None:
        reason, t_s = timeline.silence(now_s), now_s
        if not reason:
            return None
    elif arrival.problem:
        reason, t_s = arrival.problem, arrival.t_s
    else:
        return StampedEstimatorPose(arrival.t_s, stamped.pose)
    return StampedEstimatorPose(t_s, EstimatorPose(is_valid=False, reason=reason, quality=0.0))
