"""From a mesh or an outline of one's own to a body and an experiment file: `softprint new`."""
