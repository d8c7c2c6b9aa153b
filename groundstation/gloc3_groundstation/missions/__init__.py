"""Missions at the station: opened, checked, edited, saved, drawn, and steered item by item."""
