"""A window in the browser, drawn by viser (`page/`): press a body by hand (`session/`), or play files (`playback/`)."""
