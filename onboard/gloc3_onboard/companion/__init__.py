"""Component 191 for other people's software: commands, missions, parameters, files, metadata, control.

Stations of others use component 191; `routing` passes MAVLink on, `station_link` carries our own command link.
"""
