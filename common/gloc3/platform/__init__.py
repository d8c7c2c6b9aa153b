"""The platform file: what a vehicle is, can do and is limited to, and which components make it up.

The reader and the checks give every finding its place in the file.
"""

__all__ = ["bases", "limits", "places", "platform", "reader", "schema"]
