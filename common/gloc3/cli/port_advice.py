"""What to do about a port that cannot be used, as far as the system's words tell."""


def port_advice(problem: str) -> str:
    """Advice for a person who reads what is wrong with a port."""
    text = problem.lower()
    if "permission" in text or "not permitted" in text:
        return "give this user the right: sudo usermod -aG dialout $USER, then log in anew"
    if "no such file" in text or "no such device" in text:
        return "is it plugged in? ls /dev/serial/by-id names what is"
    if "in use" in text:
        return "another program has it, perhaps gloc3 onboard itself; stop that, or take another port"
    if "refused" in text or "connect call failed" in text:
        return "is the program at the other end running, and does it listen on that port?"
    return "check address, cable and power at the other end"
