"""Advice on a port that cannot be opened, from the system's error message."""


def port_advice(problem: str) -> str:
    """Advice to the user on a port error."""
    text = problem.lower()
    if "permission" in text or "not permitted" in text:
        return "give this user the right: sudo usermod -aG dialout $USER, then log in again"
    if "no such file" in text or "no such device" in text:
        return "is it plugged in? ls /dev/serial/by-id lists the devices"
    if "in use" in text:
        return "another program uses it, perhaps gloc3 onboard; stop that, or choose another port"
    if "refused" in text or "connect call failed" in text:
        return "is the program at the other end running, and does it listen on that port?"
    return "check address, cable and power at the other end"
