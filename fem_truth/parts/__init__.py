"""One body on several ranks, which solve together.

partition  which part of the body a cell belongs to
share      the nodes on this rank, and sums over all nodes: of a whole body, where they cost nothing
group      the same among the ranks of a communicator
body_part  what a solve needs to know of a body, for the nodes and cells on this rank
"""
