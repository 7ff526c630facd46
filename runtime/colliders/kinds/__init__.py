"""Kinds of colliders: one file for each, with its signed distance and its `[[colliders]]` table; list: `registry.py`.

To add one, write `NAME.py` here: a collider class (`ColliderBase`) and its `ColliderTable`, as in `sphere.py`; then
name the table in `KINDS` of `registry.py`. Schemas, `softprint keys`, messages and tests take it from there.
"""
