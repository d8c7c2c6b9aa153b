"""The network's members and their permissions: certificates and roles (docs/network.md).

`file` reads a member's network file, `stations` bridges its stations' requests, `access` derives who may what, `authority`
issues and writes certificates.
"""

__all__ = ["access", "authority", "file", "stations"]
