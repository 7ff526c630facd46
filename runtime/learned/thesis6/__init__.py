"""The displacement field of thesis chapter 6, from local descriptors of any collider."""
