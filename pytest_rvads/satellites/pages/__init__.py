"""HTML pages of reports, failures and replays."""
