"""The gate that a component's jobs pass: shut by the first that fails, or from outside when one is stuck."""


class Gate:
    """Open while the jobs of a component may go on; a shut one is never opened again.

    Jobs look at it before every call of an author's method. So nothing that waits behind a failed job is carried out,
    and a thread that comes back from a stuck call writes nothing to a device.
    """

    __slots__ = ("is_shut",)

    def __init__(self) -> None:
        self.is_shut = False
