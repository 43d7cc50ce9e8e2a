"""What every panel is given: the page, its worker, its shared state."""
