"""A window in the browser: press a body by hand (`session/`), play its files (`playback/`), drawn by viser (`page/`)."""
