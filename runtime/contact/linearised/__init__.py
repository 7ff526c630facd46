"""A solved contact linearised: how its points move, and how its energy changes, with the body and with colliders."""
