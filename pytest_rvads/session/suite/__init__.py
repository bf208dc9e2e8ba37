"""The tests that come with the plugin."""
