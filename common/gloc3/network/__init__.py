"""Who is on the network, and what each may do: members, certificates, roles (docs/network.md)."""
