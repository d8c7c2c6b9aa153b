"""What a station keeps on disk: events, recordings, fetched logs, its configuration, the queue for the next contact.

Everything survives a crash.
"""
