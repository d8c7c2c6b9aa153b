"""One mission across several vehicles: its open tasks are assigned to those in contact, and again when one drops out.

`assigning` makes the plan that is sent to all; `shared_flight` follows the vehicles and amends their missions in flight;
`crew_desk` is the operator's side of both.
"""

__all__ = ["assigning", "crew_desk", "shared_flight"]
