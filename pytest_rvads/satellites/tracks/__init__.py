"""Recorded traffic from elsewhere: logs are read, every vehicle is matched to a way through a junction, and cleaned."""
