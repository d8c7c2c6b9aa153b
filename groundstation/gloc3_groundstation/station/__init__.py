"""The CI client and what it knows: fleet snapshots, vehicles, requests, watches, alerts.

Nothing here knows links, screens or files.
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
    "snapshots",
    "station",
    "vehicles",
    "watches",
    "wording",
]
