"""The command link over MAVLink TUNNEL frames: a core without I/O, in small machines that are told the time.

Peers greet each other with broadcasts (`Hello`): role, name, clock, what is alive, and the boot number of the process,
so that a restart is seen. Topics, types and sources have numbers, told once by rows of a table and again on request.

*Best effort* (`status`): the latest message of each topic, broadcast, within a share of the link. *Reliable*
(`sending`, `receiving`): messages to one peer in three lanes, each in order, handed over once within the lives of both
processes; fragments, selective repeat by serial numbers, repeats before they are asked for while the link is idle.
`pacing` keeps to what the link carries, `outbox` decides what leaves next, `gate` what is taken, `routes` which topics
cross and how urgently. `endpoint` joins them; `gloc3.exchange.mavlink` is the shell around it.

What is promised: a message that was acknowledged has been handed over; none is handed over twice to one process; one
that is given up is told with a reason, and whether it is certain that it was not handed over.
"""

__all__ = ["endpoint", "events", "layout", "pacing", "routes"]
