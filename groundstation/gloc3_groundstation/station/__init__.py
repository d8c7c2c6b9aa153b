"""The CI client and what it knows: fleet snapshots, vehicles, requests, watches, alerts.

Nothing here knows links, screens or files.
"""
