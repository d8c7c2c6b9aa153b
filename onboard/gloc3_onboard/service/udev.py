"""Names of devices that stay: rules of udev for the cameras and serial lines that are plugged in (udev(7))."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from gloc3_onboard.sensors.source_url import SERIAL_GROUP
from gloc3_onboard.service.needs import Node

SYS: Final = Path("/sys")
FOLDER: Final = "gloc3"
"""Of the names that the rules give, below /dev."""
STEADY: Final = ("/dev/serial/", "/dev/v4l/", f"/dev/{FOLDER}/")
"""Names that do not depend on the order of plugging in."""


class UsbDevice(NamedTuple):
    """What a device on USB says of itself."""

    subsystem: str
    vendor: str
    product: str
    serial: str
    """Its serial number; empty for one that has none."""
    interface: str
    """Number of the interface of a device with several."""
    node_index: str
    """Of a camera's nodes: 0 is the one with pictures."""
    port: str
    """The kernel's name of where it is plugged in."""
    title: str


def usb_device(node: Node, sys: Path = SYS) -> UsbDevice | None:
    """What is behind a device node; None for one that is not plugged in, or not on USB.

    Args:
        node: the device.
        sys: where Linux tells it.
    """
    subsystem = "tty" if node.group == SERIAL_GROUP else "video4linux"
    entry = sys / "class" / subsystem / node.path.resolve().name
    if not entry.exists():
        return None
    interface = ""
    for folder in entry.resolve().parents:
        interface = interface or _read(folder / "bInterfaceNumber")
        if vendor := _read(folder / "idVendor"):
            title = " ".join(filter(None, (_read(folder / "manufacturer"), _read(folder / "product"))))
            product, serial = _read(folder / "idProduct"), _read(folder / "serial")
            index = _read(entry / "index") if subsystem == "video4linux" else ""
            return UsbDevice(subsystem, vendor, product, serial, interface, index, folder.name, title)
    return None


def rule(role: str, device: UsbDevice) -> str:
    """The rule that gives a device its name, by its serial number, or else by where it is plugged in."""
    matches = [f'SUBSYSTEM=="{device.subsystem}"']
    matches += [f'ENV{{ID_VENDOR_ID}}=="{device.vendor}"', f'ENV{{ID_MODEL_ID}}=="{device.product}"']
    if _is_unique(device.serial):
        matches.append(f'ENV{{ID_SERIAL_SHORT}}=="{device.serial}"')
    else:
        matches.append(f'KERNELS=="{device.port}"')
    if device.interface:
        matches.append(f'ENV{{ID_USB_INTERFACE_NUM}}=="{device.interface}"')
    if device.node_index:
        matches.append(f'ATTR{{index}}=="{device.node_index}"')
    sets = [f'SYMLINK+="{FOLDER}/{role}"']
    if device.subsystem == "tty":
        sets.append('ENV{ID_MM_DEVICE_IGNORE}="1"')
    how = "by its serial number" if _is_unique(device.serial) else "by its plug: it has no serial number of its own"
    return f"# {device.title or 'a device'}, {how}\n" + ", ".join([*matches, *sets])


def _is_unique(serial: str) -> bool:
    """Whether a serial number can be told in a rule, and tells one device from another of its make."""
    return re.fullmatch(r"[A-Za-z0-9_.:-]{4,}", serial) is not None and len(set(serial)) > 1


def rules(name: str, devices: Sequence[tuple[Node, UsbDevice]]) -> str:
    """The file of rules of a service."""
    lines = [f"# Steady names for the devices of {name}; written by gloc3 onboard install --udev"]
    lines += ["# (what is a tty is no modem: ModemManager would talk to the autopilot)"]
    return "\n".join([*lines, *(rule(node.role, device) for node, device in devices)]) + "\n"


def advice(node: Node, device: UsbDevice | None) -> str:
    """What to say of a device that is named by the order of plugging in; empty where all is well."""
    if str(node.path).startswith(STEADY) or not node.kinds:
        return ""
    if device is None:
        return f"{node.path} is not plugged in: plug it in and install again with --udev, and its name will stay"
    return (
        f"{node.path} ({device.title or 'a device'}) may be called otherwise tomorrow: --udev calls it "
        f"/dev/{FOLDER}/{node.role}"
    )


def _read(file: Path) -> str:
    try:
        return file.read_text(errors="replace").strip()
    except OSError:
        return ""
