"""The network's members and their permissions: certificates and roles (docs/network.md).

`file` reads a member's network file, `stations` bridges its stations' requests, `access` derives what each link permits,
`authority` issues and writes certificates, `signatures` has members sign their requests, `rights` decides who may what with
a vehicle by the roles in `rights_file`, `platform_clocks` follows the vehicles' clocks. `router` forwards between members,
`enrolment` makes and reads requests for certificates, `invitations` brings them by a one-time code. `revocations` is the
list of revoked members, `spreading` brings it to all. `regions` sums up the vehicles at a router.
"""

__all__ = [
    "access",
    "file",
    "platform_clocks",
    "regions",
    "revocations",
    "rights",
    "rights_file",
    "spreading",
    "stations",
]
