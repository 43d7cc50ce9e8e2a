"""What stands between the page and strangers: addresses, tokens, bounds on what is sent."""
