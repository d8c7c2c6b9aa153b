"""The station's terminal: it renders snapshots of the fleet. Nothing here knows MAVLink; nothing outside knows Textual."""
