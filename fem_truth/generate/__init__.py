"""`softprint generate`: the full-space solves of a whole plan, on one rank or many, into one truth file.

pipeline   body, recording, states, contacts, truth file: the order of work, the same on every rank
farm       which rank does what: each takes the next unit when it is free
shards     one file for each finished unit: all that a kill leaves behind is whole
plan_hash  what the shards in a folder were made from; refuses to mix two experiments
merge      shards to truth.h5
"""
