"""`softprint generate`: the full-space solves of a whole plan, on one rank or many, into one truth file.

pipeline   body, recording, states, contacts, truth file: the order of work, the same on every rank
farm       distribution of work: each rank takes the next unit when it is free
shards     one file for each finished unit, written atomically, so that a kill leaves only complete files
plan_hash  identifies the inputs of the shards in a folder; refuses to mix two experiments
merge      combines shards into truth.h5
"""
