"""The platform file: a vehicle's properties, capabilities, limits and components.

The reader and the checks give every finding its position in the file.
"""

__all__ = ["bases", "limits", "places", "platform", "reader", "schema"]
