"""Junctions cut from the metric graph of a map: arms, movements, right of way, control."""
