"""Files written completely or not at all, arrays checked before they are read, and limits on what is read."""
