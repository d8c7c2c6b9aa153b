"""RTK corrections: from an NTRIP caster, a TCP server or a serial base to every vehicle that the station receives.

`corrections` is the service; `ntrip` is the protocol without I/O, `source_url` reads addresses.
"""

__all__ = ["corrections", "source_url"]
