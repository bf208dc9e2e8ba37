"""The tests of a driver that come with the plugin."""
