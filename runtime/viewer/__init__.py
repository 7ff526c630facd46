"""A window in the browser, drawn by viser (`page/`): press a body by hand, or play files (`playback/`).

The simulation that is led by hand (`session/`) runs in processes of its own (`processes/`).
"""
