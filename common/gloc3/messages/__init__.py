"""What travels: the envelope, the messages of vehicles, perception and the command interface, and topics as rows of data.

Units, frames and the wire format stand beside them. Nothing here does I/O.
"""
