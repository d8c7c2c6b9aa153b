"""Pictures as H.264 in RTP packets, by the encoder and the packetizer of FFmpeg (PyAV)."""

from fractions import Fraction
from typing import Any, Final

import numpy as np

from gloc3.messages.vehicle import Image

PAYLOAD_TYPE: Final = 96
CLOCK_HZ: Final = 90_000
PACKET_BYTES: Final = 1_400
KEY_FRAME_S: Final = 1.0
"""Longest time for which a viewer who joins waits for a whole picture, s."""
BIT_RATE: Final = 2_000_000
_RATE_HZ: Final = 15
"""Assumed rate of pictures, for the encoder's budget; they may come at any."""
_CONTROL: Final = range(200, 205)
"""Packet types of RTCP, which share the packetizer's output."""


class VideoEncoder:
    """Encodes pictures of one size. Not for two threads at once.

    Args:
        width: columns, even.
        height: rows, even.
    """

    def __init__(self, width: int, height: int) -> None:
        self._av = load_av()
        self.size: Final = (width, height)
        self._packets: list[bytes] = []
        options = {"packetsize": str(PACKET_BYTES), "payload_type": str(PAYLOAD_TYPE)}
        self._container: Any = self._av.open(self, "w", format="rtp", options=options)
        codec = {"preset": "veryfast", "tune": "zerolatency", "profile": "baseline"}
        stream = self._stream = self._container.add_stream("libx264", rate=_RATE_HZ, options=codec)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = width, height, "yuv420p", BIT_RATE
        stream.codec_context.time_base = Fraction(1, CLOCK_HZ)
        stream.codec_context.gop_size = round(_RATE_HZ * KEY_FRAME_S)
        self._last = -1

    def write(self, data: bytes) -> int:
        """Takes one packet of the packetizer."""
        self._packets.append(bytes(data))
        return len(data)

    def encode(self, image: Image, t_s: float, *, is_key: bool) -> list[bytes]:
        """RTP and RTCP packets of one picture.

        Args:
            image: in colour or grey.
            t_s: its time; earlier ones than the last are moved behind it.
            is_key: whether it must be decodable without earlier ones.
        """
        shape = (image.height, image.width)
        if image.bgr:
            pixels = np.frombuffer(image.bgr, np.uint8).reshape(*shape, 3)
        else:
            pixels = np.frombuffer(image.data, np.uint8).reshape(shape)
        width, height = self.size
        frame = self._av.VideoFrame.from_ndarray(
            np.ascontiguousarray(pixels[:height, :width]), format="bgr24" if image.bgr else "gray"
        )
        self._last = max(round(t_s * CLOCK_HZ), self._last + 1)
        frame.pts, frame.time_base = self._last, Fraction(1, CLOCK_HZ)
        if is_key:
            frame.pict_type = self._av.video.frame.PictureType.I
        for packet in self._stream.encode(frame):
            self._container.mux(packet)
        found, self._packets = self._packets, []
        return found

    def close(self) -> None:
        """Frees the encoder."""
        self._container.close()
        self._packets.clear()


def load_av() -> Any:
    """PyAV; where it is missing, the program names the extra that brings it."""
    import av
    import av.video.frame

    return av


def is_control(packet: bytes) -> bool:
    """Whether a packet is RTCP."""
    return packet[1] in _CONTROL
