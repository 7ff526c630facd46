"""The page in the browser: the server and its guard, the scene, and the panel of controls."""
