"""One body partitioned over several ranks, which solve together.

partition  the part of the body that each cell belongs to
share      the nodes on this rank, and sums over all nodes: for a whole body on one rank, without communication
group      the same for a body on the ranks of a communicator
body_part  the body data that a solve needs, for the nodes and cells on this rank
"""
