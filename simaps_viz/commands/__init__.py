"""What each `simaps` command takes and does, one a file; `cli` calls them."""
