"""Missions for test cards: up, along the hold, down; short, with the policies that a card asks for."""

from typing import Any

from gloc3.platform.reader import whole_text

FENCE = "{polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]], ceiling_m: 8}"
UP = "depart: {actions: {climb: {take_off: {height_m: 1.5}}}}"
DOWN = "recover: {after: [sweep], actions: {down: {land: {}}}}"
OUT = "follow_waypoints: {waypoints_m: [[8, 0, 1.5]], speed_m_s: 1.0}"
PHOTOGRAPHED = """\
mission: up
frame: hold
geofence: {polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]], ceiling_m: 8}
on_failure: land
on_link_loss: land
on_low_battery: land
on_pose_lost: land
tasks:
  up:
    actions:
      climb: {take_off: {height_m: 0.5}}
      photos: {record_images: {camera: front_left, every_s: 1}, until: down}
      down: {land: {}, after: [climb]}
"""
"""A hop in the hold with pictures of the front camera."""


def mission(sweep: str = "{out: {" + OUT + "}}", *, options: str = "", fence: str = FENCE, **policies: Any) -> str:
    """Up to 1.5 m, a sweep, and down.

    Args:
        sweep: the sweep's actions, as YAML.
        options: the sweep's other keys, as YAML with a comma behind, such as `deadline_s: 5,`.
        fence: the fence, as YAML.
        policies: keys at the top, such as `on_link_loss="land"`.
    """
    keys = {"on_failure": "land", "on_link_loss": "continue", **policies}
    tops = [f"{key}: {value}" for key, value in keys.items()]
    sweep = f"sweep: {{after: [depart], {options} actions: {sweep}}}"
    tasks = [f"  {task}" for task in (UP, sweep, DOWN)]
    return "\n".join(["mission: card", "frame: hold", f"geofence: {fence}", *tops, "tasks:", *tasks]) + "\n"


def platform(changes: dict[str, str]) -> str:
    """The Pelican's platform file with other words in it, under another name: text to what stands in its place."""
    text = whole_text("pelican_rtk")
    for previous, new in {"platform: pelican": "platform: heron", **changes}.items():
        assert previous in text, previous
        text = text.replace(previous, new)
    return text
