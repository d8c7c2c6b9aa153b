"""The command link over MAVLink TUNNEL frames: a core without I/O, in small machines that are told the time."""
