"""What an operator can do now, and doing it: missions, components, the fleet, vehicle services, steering by hand.

A desk is given the station; screens and the headless station call it.
"""
