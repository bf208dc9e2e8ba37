"""Maps: OpenDRIVE files, metric graphs, junctions."""
