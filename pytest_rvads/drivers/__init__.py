"""What drives: the interface, the tracking controller, the reference autopilot, traffic policies, stacks in other processes."""
