"""Writes junctions of maps in other formats as OpenDRIVE, for simulators and checks that read only OpenDRIVE."""
