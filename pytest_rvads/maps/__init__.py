"""What a map is before anybody looks for junctions: lanes in the direction of travel, their centre lines, what is doubtful."""
