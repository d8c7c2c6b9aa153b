"""What corrections take of a link: a share of its line, whole frames, nothing late, the base's position first."""

from tests.common.rtcm_frames import SAMPLE_1005, observations

from gloc3.rtcm3 import RtcmFrame
from gloc3_groundstation.corrections.correction_queue import NETWORK_BYTE_S, CorrectionQueue, rate_byte_s


def test_the_rate_is_a_share_of_the_line_s() -> None:
    assert rate_byte_s("serial:///dev/ttyUSB0:57600") == 1728.0
    assert rate_byte_s("serial:///dev/ttyUSB0:auto") == 1728.0
    assert rate_byte_s("udpout://10.0.0.1:14550?rate=19200") == 576.0
    assert rate_byte_s("udpin://0.0.0.0:14550") == NETWORK_BYTE_S
    assert rate_byte_s("memory") == NETWORK_BYTE_S


def test_a_slow_link_gets_its_rate_and_no_frame_late() -> None:
    queue, sent = CorrectionQueue(500.0), list[tuple[float, RtcmFrame]]()
    for tenth in range(600):
        now_s = tenth / 10.0
        if tenth % 10 == 0:
            for message_type in (1077, 1087, 1097, 1127):
                queue.put(RtcmFrame(observations(250, message_type)), now_s)
        if tenth % 100 == 0:
            queue.put(RtcmFrame(SAMPLE_1005), now_s)
        sent += [(now_s, frame) for frame in queue.ready(now_s)]
    size = sum(len(frame.raw) + 16 * (1 + len(frame.raw) // 180) for _, frame in sent)
    assert 0.95 * 500.0 * 60.0 < size < 1.05 * 500.0 * 60.0 + 400.0
    assert sum(frame.message_type == 1005 for _, frame in sent) == 6
    assert 236 <= queue.left_out + sum(frame.message_type != 1005 for _, frame in sent) <= 240
    assert queue.left_out > 100


def test_a_quick_link_gets_all_at_once() -> None:
    queue = CorrectionQueue(NETWORK_BYTE_S)
    queue.put(RtcmFrame(observations(100)), 0.0)
    queue.put(RtcmFrame(observations(100, 1087)), 0.0)
    assert [frame.message_type for frame in queue.ready(0.0)] == [1077, 1087]
    assert queue.next_s() is None
