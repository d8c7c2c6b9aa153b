"""The commands `gloc3 calibrate`: cameras, pairs, their place and time on the vehicle, scanners, magnetometers."""

from cyclopts import App

from gloc3_onboard.calibrating.camera import camera
from gloc3_onboard.calibrating.camera_imu import camera_imu
from gloc3_onboard.calibrating.laser_imu import laser_imu
from gloc3_onboard.calibrating.magnetometer import magnetometer
from gloc3_onboard.calibrating.stereo import stereo

app = App(
    name="gloc3 calibrate",
    help="""Calibrate a vehicle's sensors, from live data, folders of pictures or logs, into a rig file.

    Each command shows what the data cover, draws the residuals (`--report`), and states a standard deviation beside each
    value. It writes the result with its date into the rig file (`rig.yaml`), whose cameras are a camchain of Kalibr and go
    into a platform file as `front: "rig.yaml#cam0"`. A result that is not trustworthy is refused with the reason, unless
    `--force` is given. Exit codes: 0 written, 1 not trustworthy, 2 wrong use or unusable data.

    For example, with a board of AprilTags as for Kalibr:

    - `gloc3 calibrate stereo v4l2:///dev/video2 v4l2:///dev/video4 --board aprilgrid.yaml --report stereo.svg`
    - `gloc3 calibrate camera-imu runs/shaken/log.mcap#camera/front_left --board aprilgrid.yaml`
    - `gloc3 calibrate laser-imu runs/turned/log.mcap --rig laser.yaml`
    - `gloc3 calibrate magnetometer serial:///dev/ttyACM0:115200 --rig magnetometer.yaml`""",
    help_format="markdown",
    version_flags=[],
)

app.command(camera)
app.command(stereo)
app.command(camera_imu)
app.command(laser_imu)
app.command(magnetometer)
