"""autopilots"""
