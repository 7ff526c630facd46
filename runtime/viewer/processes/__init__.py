"""A session, its pictures and its recordings in processes of their own, so that none of them waits for another."""
