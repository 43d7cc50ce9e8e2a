"""The page on which a person sees a map, asks about it, and drives a robot on it.

`workbench` serves it and keeps a `session` for every browser tab. A session is a `page` with its `panels`, docked
side by side: panels ask the page for changes, the page computes, paints its `scene`, and reports events to all panels.
`recording` ties it to a docked recording, `server` is what is between the page and the network, and `page.share` makes
files that need none of this.
"""
