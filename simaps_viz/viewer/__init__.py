"""The page on which a person sees, questions and drives on a map.

`workbench` serves it and keeps a `session` for every browser tab; a session lays out `panels`, draws with `drawing`,
drives with `driving` and is tied to a docked recording by `recording`. `server` is what stands between the page and
strangers, `share` makes files for those who have none of this. Computing comes in as callables (`services`).
"""
