"""Who may do what in the graph.

policy  which topics and services has each node, as SROS 2 wants it?"""
