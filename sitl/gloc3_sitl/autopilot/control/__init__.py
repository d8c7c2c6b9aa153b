"""The cascade of control loops, from a wanted position down to four throttles."""
