"""The data log (DESIGN §10): MCAP files that are written crash-safe, read although damaged, drawn and replayed.

Recorders use `record`, everybody else reads through `reader`; reports are a room of their own.
"""

__all__ = ["disk_file", "foxglove", "info", "payloads", "reader", "record"]
