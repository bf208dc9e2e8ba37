"""From a scenario and its drivers to a run."""
