"""OpenDRIVE files: read into a network of lanes, written for the built-in junctions."""
