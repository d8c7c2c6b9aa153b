"""Data that a station keeps on disk: events, recordings, fetched logs, its configuration, the queue for the next contact.

Everything survives a crash.
"""

__all__ = [
    "configuration",
    "contact_queue",
    "download_progress",
    "event_search",
    "event_store",
    "kept_state",
    "log_pull",
    "recording",
]
