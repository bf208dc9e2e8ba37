"""From the metric graph of a map to its junctions: arms, movements, right of way, what regulates them."""
