"""One module for each verb of `softprint` that needs the runtime only."""
