"""What measures the checks and the simulators themselves; run in a clone, no part of the installed package."""
