"""Pictures of runs, junctions and curves as SVG, and replay pages of runs."""
