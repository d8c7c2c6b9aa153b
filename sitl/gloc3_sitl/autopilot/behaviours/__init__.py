"""What the vehicle can do, one class each: told the time, it gives a setpoint every 20 ms."""
