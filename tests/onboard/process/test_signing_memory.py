"""What signed links have heard, over a crash and over an orderly restart."""

import asyncio
from pathlib import Path

from gloc3.clock import Clock, run_virtual
from gloc3.mavlink.codec import Encoder, Frame, Parser, message
from gloc3.mavlink.signing import Signing, SigningVerdict, timestamp
from gloc3_onboard.process.process_storage import AHEAD, SigningMemory

KEY = bytes(range(32))
AHEAD_S = AHEAD / 100_000


class Sender:
    """A station whose clock is half a minute fast, so that its frames outlive any restart."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._signing = Signing(KEY, link_id=1, now=self._time())
        self._encoder = Encoder(255, 190, self._signing)

    def _time(self) -> int:
        return timestamp(self._clock.utc_s() + 30.0)

    def frame(self) -> Frame:
        self._signing.advance(self._time())
        (frame,) = Parser().receive(self._encoder.encode(message("HEARTBEAT", type=6)))
        return frame


async def _restart(folder: Path, *, is_orderly: bool, reported: list[str]) -> list[SigningVerdict]:
    """Eight frames are heard, a second apart; of these, of a new one at once, and of one a while later."""
    clock = Clock(asyncio.get_running_loop())
    sender, before = Sender(clock), SigningMemory(folder, clock, reported.append)
    signing, received = before.signing(KEY, 1), []
    for _ in range(8):
        received.append(sender.frame())
        assert signing.verify(received[-1]) is SigningVerdict.GENUINE
        await asyncio.sleep(1.0)
    if is_orderly:
        before.close()
    again = SigningMemory(folder, clock, reported.append).signing(KEY, 1)
    verdicts = [again.verify(frame) for frame in (*received, sender.frame())]
    await asyncio.sleep(AHEAD_S)
    return [*verdicts, again.verify(sender.frame())]


def test_nothing_is_taken_once_more_after_a_restart_and_who_goes_on_is_heard(tmp_path: Path) -> None:
    reported: list[str] = []
    *previous, new, later = run_virtual(_restart(tmp_path / "crashed", is_orderly=False, reported=reported))
    assert set(previous) == {SigningVerdict.REPEATED}
    assert (new, later) == (SigningVerdict.REPEATED, SigningVerdict.GENUINE), (
        "what may have been heard before the crash is not taken"
    )
    *previous, new, later = run_virtual(_restart(tmp_path / "stopped", is_orderly=True, reported=reported))
    assert set(previous) == {SigningVerdict.REPEATED}
    assert (new, later) == (SigningVerdict.GENUINE, SigningVerdict.GENUINE)
    files = list((tmp_path / "crashed").iterdir())
    assert len(files) == 2, "what was on disk, and what may not be yet"
    assert not any(KEY in file.read_bytes() or KEY.hex()[:8] in file.name for file in files)
    assert reported == []


def test_a_file_that_cannot_be_kept_or_read_is_told_and_keeps_nobody_out(tmp_path: Path) -> None:
    reported: list[str] = []
    (tmp_path / "taken").write_text("a file, not a folder")
    *previous, new, _ = run_virtual(_restart(tmp_path / "taken", is_orderly=False, reported=reported))
    assert set(previous) == {SigningVerdict.GENUINE}, "that is what is told"
    assert new is SigningVerdict.GENUINE
    assert len(reported) == 4, "each of the two once"
    assert "cannot be read" in reported[0]
    assert "may be accepted again" in reported[1]
