"""Maps before the search for junctions: lanes in the direction of travel, centre lines, signs and lights, warnings."""
