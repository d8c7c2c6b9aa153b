"""Command interface client and its state: fleet snapshots, vehicles, requests, watches, alerts.

Independent of links, screens and files.
"""

__all__ = [
    "alerts",
    "command_client",
    "data_chain",
    "event_feed",
    "fleet",
    "message_fields",
    "pictures",
    "preview_size",
    "regions",
    "snapshots",
    "station",
    "vehicles",
    "watches",
    "wording",
]
