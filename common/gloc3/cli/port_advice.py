"""What to do about a port that cannot be used, as far as the system's words tell."""


def port_advice(problem: str) -> str:
    """Advice for a person who reads what is wrong with a port."""
    said = problem.lower()
    if "permission" in said or "not permitted" in said:
        return "give this user the right: sudo usermod -aG dialout $USER, then log in anew"
    if "no such file" in said or "no such device" in said:
        return "is it plugged in? ls /dev/serial/by-id names what is"
    if "in use" in said:
        return "another program has it, perhaps gloc3 onboard itself; stop that, or take another port"
    if "refused" in said or "connect call failed" in said:
        return "is the program at the other end running, and does it listen on that port?"
    return "check address, cable and power at the other end"
