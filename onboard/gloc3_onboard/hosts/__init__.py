"""The processes and hosts of a platform: how they are begun, led, timed and looked after."""
