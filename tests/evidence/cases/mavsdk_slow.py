"""Cases for mavsdk that take long, or may: a file transfer that breaks off is given up after half a minute, and a calibration
is cancelled by a call without a time-out.
"""

from pathlib import Path
from typing import Any

import pytest
from mavsdk.plugins.calibration import Calibration
from mavsdk.plugins.ftp import Ftp
from tests.sitl.cases.test_mavsdk_system import BIG, check_big_file, fresh, put
from tests.sitl.mavsdk_client import client_at, client_of, outcome, simulated_vehicle
from tests.sitl.relay import relay

FILES = 110
"""FILE_TRANSFER_PROTOCOL."""


@pytest.mark.parametrize("is_burst", [False, True])
def test_ftp_download_that_breaks_off_can_be_done_again(tmp_path: Path, is_burst: bool) -> None:
    folder = tmp_path / "down"
    folder.mkdir()
    with simulated_vehicle() as port, relay(port, delay_s=0.01) as link, client_at(link.port) as slow:
        put(slow, fresh(slow), tmp_path, "big.bin", BIG)
        files = slow.plugin(Ftp)
        rows: list[Any] = []
        files.download_async("/case/big.bin", str(folder), is_burst, lambda *values: rows.append(values))
        slow.await_telemetry("position", lambda _: len(rows) > 2)
        link.dropped_id = FILES
        slow.await_telemetry("position", lambda _: rows[-1][0].name != "NEXT", within_s=90.0)
        assert rows[-1][0].name == "TIMEOUT"
        link.dropped_id = None
        again = slow.reported(files.download_async, "/case/big.bin", str(folder), is_burst, within_s=60.0)
        assert again[-1][0].name == "SUCCESS"
    assert (folder / "big.bin").read_bytes() == BIG


def test_ftp_upload_that_breaks_off_can_be_done_again(tmp_path: Path) -> None:
    source = tmp_path / "big.bin"
    source.write_bytes(BIG)
    with simulated_vehicle() as port, relay(port, delay_s=0.01) as link, client_at(link.port) as slow:
        files = fresh(slow)
        rows: list[Any] = []
        files.upload_async(str(source), "/case", lambda *values: rows.append(values))
        slow.await_telemetry("position", lambda _: len(rows) > 2)
        link.dropped_id = FILES
        slow.await_telemetry("position", lambda _: rows[-1][0].name != "NEXT", within_s=90.0)
        assert rows[-1][0].name == "TIMEOUT"
        link.dropped_id = None
        put(slow, files, tmp_path, "big.bin", BIG)
        assert files.are_files_identical(str(source), "/case/big.bin")


def test_ftp_upload_and_download_of_a_big_file_over_a_link_that_loses_one_in_ten(tmp_path: Path) -> None:
    with simulated_vehicle() as port, relay(port, loss=0.1, seed=3) as link, client_at(link.port) as client:
        check_big_file(client, tmp_path, BIG[:8192])


@pytest.mark.parametrize("word", ["magnetometer", "accelerometer"])
def test_a_calibration_that_nobody_turns_the_vehicle_for_is_cancelled(word: str) -> None:
    with client_of() as client:
        client.await_armable()
        calibration = client.plugin(Calibration)
        rows: list[Any] = []
        getattr(calibration, f"calibrate_{word}_async")(lambda *values: rows.append(values))
        client.await_telemetry("position", lambda _: any(row[1].has_status_text for row in rows))
        assert outcome(calibration.cancel) == "SUCCESS"
        client.await_telemetry("position", lambda _: rows[-1][0].name == "CANCELLED")
