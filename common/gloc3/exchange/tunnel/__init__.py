"""The command link over MAVLink TUNNEL frames: a core without I/O, in small state machines that receive the time.

Peers announce themselves with broadcasts (`Hello`): role, name, clock, liveliness tokens, and the boot number of the
process, so that a restart is detected. Topics, types and sources have numbers, defined by rows of a table, which are
sent once and again on request.

*Best effort* (`status`): the latest message of each topic, broadcast, within a share of the link. *Reliable*
(`sending`, `receiving`): messages to one peer in three lanes, each in order, delivered once within the lives of both
processes; fragments, selective repeat by serial numbers, unrequested repeats while the link is idle. `pacing` keeps to
the bandwidth of the link, `outbox` decides what is sent next, `gate` what is accepted, `routes` which topics cross and
with which priority. `endpoint` joins them; `gloc3.exchange.mavlink` is the shell around it.

Guarantees: an acknowledged message has been delivered; none is delivered twice to one process; one that is given up is
reported with a reason, and whether it is certain that it was not delivered.
"""

__all__ = ["endpoint", "events", "layout", "pacing", "routes"]
