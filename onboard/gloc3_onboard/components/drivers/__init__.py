"""The drivers of the example platforms, one component a file.

They are found through entry points and reach each other by topics only.
"""

__all__ = ["image_recorder", "manoeuvres"]
