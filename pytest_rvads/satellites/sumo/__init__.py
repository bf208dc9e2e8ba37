"""The simulator ``sumo``: Eclipse SUMO drives the vehicles that its driver is named for, in a process of its own."""
