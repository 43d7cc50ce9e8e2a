"""Files written whole, arrays read with care, limits."""
