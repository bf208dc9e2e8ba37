"""Drivers of vehicles: their interface, the tracking controller, the reference autopilot, traffic, drivers in other processes."""
